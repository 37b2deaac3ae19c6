// The elements over the canvas: the names of panes, the handle of the swipe, the outline of the inspected texel,
// failing areas, legends.

(() => {
  const canvas = stage.canvas;
  const layer = byId("overlay");
  const handle = byId("handle");
  const legend = byId("legend");
  const NAMES = { golden: "Golden", actual: "Actual", difference: "Actual − golden", map: "Map" };
  const ratio = () => window.devicePixelRatio || 1;
  const css = (pixels) => `${pixels / ratio()}px`;

  const label = (pane) => {
    const name = pane.layer === "map" ? loaded()?.maps[state.map]?.name ?? "no map"
      : part()?.names?.[pane.layer] ?? NAMES[pane.layer];
    const missing = pane.layer !== "map" && loaded() && missingSide(pane.layer);
    const made = element("span", { className: "pane" }, missing ? `${name}: none` : name, ...everywhere(pane));
    const right = state.view === "swipe" && pane.layer === "actual";
    made.style.top = css(pane.clip.y);
    if (right) made.style.right = "0";
    else made.style.left = css(pane.clip.x);
    return made;
  };

  // An outline around the whole image would be useless. A text says that the whole image fails.
  const everywhere = (pane) => {
    const spread = isOutlined(pane) && failing.of(loaded())?.spread;
    return spread ? [element("span", { className: "spread" }, ` fails all over: ${spread}`)] : [];
  };

  const missingSide = (side) => {
    const { golden, actual } = part() ?? {};
    return side === "difference" ? !golden || !actual : !part()?.[side];
  };

  // Returns an outline around texels, in each pane. An outline that would be smaller than `least` points is enlarged
  // around its middle.
  const framed = (pane, [left, top, right, bottom], className, least = 3) => {
    const [x, y] = stage.origin(pane);
    const box = element("span", { className });
    const side = (from, to, offset) => {
      const size = Math.max((to - from + 1) * state.scale, least * ratio());
      const middle = offset + ((from + to + 1) / 2) * state.scale;
      return [css(middle - size / 2), css(size)];
    };
    const [start, width] = side(left, right, x - pane.clip.x);
    const [above, height] = side(top, bottom, y - pane.clip.y);
    Object.assign(box.style, { left: start, top: above, width, height });
    const window_ = element("span", { className: "clip" }, box);
    Object.assign(window_.style, {
      left: css(pane.clip.x), top: css(pane.clip.y), width: css(pane.clip.w), height: css(pane.clip.h),
    });
    return window_;
  };

  // Outlines each failing area: with a thin line around large areas, and with a ring around areas that you could
  // overlook.
  const RING = 13; // points
  const isOutlined = (pane) => state.outlines && !state.part && pane.layer !== "golden";
  const outlined = (pane) => {
    if (!isOutlined(pane)) return [];
    const boxes = (failing.of(loaded())?.boxes ?? []).filter(({ whole }) => !whole);
    return boxes.map(({ left, top, right, bottom }) => {
      const size = (Math.max(right - left, bottom - top) + 1) * state.scale;
      const small = size < RING * ratio();
      return framed(pane, [left, top, right, bottom], small ? "area small" : "area", small ? RING : 3);
    });
  };

  // Strips of colours with their values.
  const strip = (colors, ticks, title) => {
    const context = legend.querySelector("canvas").getContext("2d");
    const { width, height } = Object.assign(context.canvas, { height: 10 * colors.length });
    colors.forEach((color, row) => {
      for (let x = 0; x < width; x += 1) {
        const rgb = color(x / (width - 1)).map((value) => Math.round(255 * value));
        context.fillStyle = `rgb(${rgb.join(" ")})`;
        context.fillRect(x, 10 * row, 1, height);
      }
    });
    legend.querySelector(".title").textContent = title;
    legend.querySelector(".ticks").replaceChildren(...ticks.map((tick) => element("span", {}, tick)));
    legend.hidden = false;
  };

  const showLegend = () => {
    legend.hidden = true;
    if (!part()) return;
    const channel = state.channel ? CHANNELS[state.channel] : "largest channel";
    if (state.view === "difference" && !missingSide("difference")) {
      const range = 2 ** -state.gain / (state.relative ? 1 : 2 ** state.exposure);
      const [ends, middle] = [range, range / 2].map((value) => numbers.rounded(value));
      const of = state.how && !state.channel ? "R, G and B" : channel;
      const what = state.how === 2 ? "size of " : "";
      const title = `${what}${state.relative ? "difference relative to golden" : "actual − golden"}, ${of}`;
      const rows = state.channel ? [[1, 1, 1]] : [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
      if (state.how === 2) {
        const colors = rows.map((row) => (t) => tones.absolute(row.map((x) => x * t), state.channel));
        strip(colors, ["equal", middle, ends], title);
      } else {
        const ticks = [`−${ends}`, `−${middle}`, "equal", `+${middle}`, `+${ends}`];
        const colors = state.how
          ? rows.map((row) => (t) => tones.byChannel(row.map((x) => x * (2 * t - 1)), state.channel))
          : [(t) => tones.signed(2.02 * t - 1.01)];
        strip(colors, ticks, title);
      }
    } else if (state.view === "map") {
      const map = loaded()?.maps[state.map];
      if (map?.scalar) {
        const [low, high] = map.range;
        strip([tones.turbo], [low, (low + high) / 2, high].map((tick) => numbers.rounded(tick)), map.name);
      }
    } else if (state.falseColor) {
      const { STOPS } = tones;
      const light = (t) => tones.falseColor(0.18 * 2 ** ((2 * t - 1) * STOPS));
      const ticks = [`−${STOPS}`, `−${STOPS / 2}`, "0.18", `+${STOPS / 2}`, `+${STOPS}`];
      strip([light], ticks, "stops from middle grey, as exposed");
    }
  };

  const message = () => {
    const current = selectedCase();
    if (!stage.gl) {
      return "This browser has no WebGL 2, which the page needs to show float images. Turn on hardware acceleration, or open the page in a current Firefox, Chrome, Edge or Safari.";
    }
    if (stage.gl.isContextLost()) return "The browser has taken the graphics memory back. The page continues when it gets the memory again; otherwise reload the page.";
    if (!current && state.absent && state.cases.length) return `\`${state.absent}\` isn't pending: it was accepted or rejected, or it has another name. Choose a frame from the list.`;
    if (!current) return "Nothing is pending.";
    if (current.error) return current.error;
    if (!current.data) return "Loading …";
    if (current.table || current.status === "function") return ""; // it covers the canvas
    const { golden, actual } = part();
    const sizes = golden && actual && (golden.width !== actual.width || golden.height !== actual.height);
    if (current.status === "golden" && !part().version) return ["golden", "side"].includes(state.view) ? "" : "Nothing is pending for this golden.";
    if (state.view === "difference" && !golden) return "There is no golden to compare with.";
    if (state.view === "difference" && sizes) {
      return `The sizes differ: golden ${golden.width} × ${golden.height}, actual ${actual.width} × ${actual.height}. The page shows only the part that both images have, from the top left corner.`;
    }
    if (state.view === "map" && !current.data.maps.length) return "This case has no maps.";
    return "";
  };

  listeners.push(() => {
    stage.draw();
    const panes = part() && !loaded().table && stage.gl ? stage.panes() : [];
    const marks = panes.flatMap((pane) => {
      const pin = state.pinned ? [framed(pane, [...state.pinned, ...state.pinned], "pin")] : [];
      return [...outlined(pane), label(pane), ...pin];
    });
    layer.replaceChildren(...marks);
    handle.hidden = state.view !== "swipe" || !part();
    handle.style.left = `${100 * state.swipe}%`;
    handle.setAttribute("aria-valuenow", String(Math.round(100 * state.swipe)));
    showLegend();
    const text = message();
    byId("message").textContent = text;
    byId("message").hidden = !text;
    canvas.dataset.ready = String(Boolean(loaded() || !selectedCase() || selectedCase().error));
  });

  const resized = new ResizeObserver(() => change());
  try {
    resized.observe(canvas, { box: "device-pixel-content-box" });
  } catch {
    resized.observe(canvas); // Safari
  }
  // On another screen, or with the browser's zoom, the element's size in points may stay the same.
  const watchRatio = () => {
    const media = matchMedia(`(resolution: ${ratio()}dppx)`);
    media.addEventListener("change", () => { change(); watchRatio(); }, { once: true });
  };
  watchRatio();
})();
