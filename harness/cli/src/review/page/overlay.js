// What lies over the canvas: names of panes, the swipe's handle, the frame around the inspected
// texel, legends; and the pointer, which pans, zooms and inspects.

(() => {
  const canvas = stage.canvas;
  const layer = byId("overlay");
  const handle = byId("handle");
  const legend = byId("legend");
  const NAMES = { golden: "Golden", actual: "Actual", difference: "Actual − golden", map: "Map" };
  const ratio = () => window.devicePixelRatio || 1;
  const css = (pixels) => `${pixels / ratio()}px`;

  const label = (pane) => {
    const name = pane.layer === "map" ? loaded()?.maps[state.map]?.name ?? "no map" : NAMES[pane.layer];
    const missing = pane.layer !== "map" && loaded() && missingSide(pane.layer);
    const made = element("span", { className: "pane" }, missing ? `${name}: none` : name);
    const right = state.view === "swipe" && pane.layer === "actual";
    made.style.top = css(pane.clip.y);
    if (right) made.style.right = "0";
    else made.style.left = css(pane.clip.x);
    return made;
  };

  const missingSide = (side) => {
    const { golden, actual } = part() ?? {};
    return side === "difference" ? !golden || !actual : !part()?.[side];
  };

  // A frame around texels, in each pane.
  const framed = (pane, [left, top, right, bottom], className) => {
    const [x, y] = stage.origin(pane);
    const box = element("span", { className });
    const size = (texels) => css(Math.max(texels * state.scale, 3));
    Object.assign(box.style, {
      left: css(x + left * state.scale - pane.clip.x), top: css(y + top * state.scale - pane.clip.y),
      width: size(right - left + 1), height: size(bottom - top + 1),
    });
    const window_ = element("span", { className: "clip" }, box);
    Object.assign(window_.style, {
      left: css(pane.clip.x), top: css(pane.clip.y), width: css(pane.clip.w), height: css(pane.clip.h),
    });
    return window_;
  };

  // A strip of colours with its values.
  const strip = (color, ticks, title) => {
    const context = legend.querySelector("canvas").getContext("2d");
    const { width, height } = context.canvas;
    for (let x = 0; x < width; x += 1) {
      const rgb = color(x / (width - 1)).map((value) => Math.round(255 * value));
      context.fillStyle = `rgb(${rgb.join(" ")})`;
      context.fillRect(x, 0, 1, height);
    }
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
      const ends = numbers.rounded(range);
      const title = state.relative ? `relative to golden, ${channel}` : `actual − golden, ${channel}`;
      strip((t) => tones.signed(2.02 * t - 1.01), [`−${ends}`, "equal", `+${ends}`], title);
    } else if (state.view === "map") {
      const map = loaded()?.maps[state.map];
      if (map?.scalar) {
        const [low, high] = map.range;
        strip(tones.turbo, [low, (low + high) / 2, high].map((tick) => numbers.rounded(tick)), map.name);
      }
    } else if (state.falseColor) {
      const { STOPS } = tones;
      const light = (t) => tones.falseColor(0.18 * 2 ** ((2 * t - 1) * STOPS));
      const ticks = [`−${STOPS}`, `−${STOPS / 2}`, "0.18", `+${STOPS / 2}`, `+${STOPS}`];
      strip(light, ticks, "stops from middle grey, as exposed");
    }
  };

  const message = () => {
    const current = selectedCase();
    if (!stage.gl) {
      return "This browser has no WebGL 2, which the page needs to show float images. Turn on hardware acceleration, or open the page in a current Firefox, Chrome, Edge or Safari.";
    }
    if (stage.gl.isContextLost()) return "The browser has taken the graphics memory back. The page goes on when it gives it again; else reload it.";
    if (!current && state.absent && state.cases.length) return `\`${state.absent}\` isn't pending: it has been decided, or has another name. Choose one from the list.`;
    if (!current) return "Nothing is pending.";
    if (current.error) return current.error;
    if (!current.data) return "Loading …";
    if (current.table) return ""; // it lies over the canvas
    const { golden, actual } = part();
    const sizes = golden && actual && (golden.width !== actual.width || golden.height !== actual.height);
    if (state.view === "difference" && !golden) return "There is no golden to differ from.";
    if (state.view === "difference" && sizes) {
      return `The sizes differ: golden ${golden.width} × ${golden.height}, actual ${actual.width} × ${actual.height}. What both have is shown from the top left corner.`;
    }
    if (state.view === "map" && !current.data.maps.length) return "This case has no maps.";
    return "";
  };

  listeners.push(() => {
    stage.draw();
    const panes = loaded() && !loaded().table && stage.gl ? stage.panes() : [];
    const marks = panes.flatMap((pane) => {
      const pin = state.pinned ? [framed(pane, [...state.pinned, ...state.pinned], "pin")] : [];
      return [label(pane), ...pin];
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

  const position = (event) => {
    const box = canvas.getBoundingClientRect();
    return [(event.clientX - box.left) * ratio(), (event.clientY - box.top) * ratio()];
  };

  let dragged = null;
  canvas.addEventListener("pointerdown", (event) => {
    if (!stage.gl || event.button > 1) return;
    canvas.setPointerCapture(event.pointerId);
    dragged = { from: position(event), center: state.center, moved: false };
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!stage.gl) return;
    const [x, y] = position(event);
    if (dragged) {
      const [dx, dy] = [x - dragged.from[0], y - dragged.from[1]];
      dragged.moved ||= Math.hypot(dx, dy) > 3 * ratio(); // a hand is not that steady
      if (dragged.moved) {
        const center = [dragged.center[0] - dx / state.scale, dragged.center[1] - dy / state.scale];
        change({ center, fit: false });
      }
    }
    change({ hover: stage.texelAt(paneAt(x, y), x, y) });
  });
  canvas.addEventListener("pointerup", (event) => {
    if (dragged && !dragged.moved) {
      const at = stage.texelAt(paneAt(...position(event)), ...position(event));
      const same = state.pinned && state.pinned.join() === at.join();
      const [width, height] = extent();
      const inside = at[0] >= 0 && at[1] >= 0 && at[0] < width && at[1] < height;
      change({ pinned: same || !inside ? null : at });
    }
    dragged = null;
  });
  canvas.addEventListener("pointercancel", () => { dragged = null; });
  canvas.addEventListener("pointerleave", () => change({ hover: null }));
  canvas.addEventListener("wheel", (event) => {
    if (!stage.gl) return;
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 40 : 1;
    zoom(2 ** (-event.deltaY * lines / 400), position(event));
  }, { passive: false });

  const slide = (event) => {
    const box = canvas.getBoundingClientRect();
    change({ swipe: Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)) });
  };
  handle.addEventListener("pointerdown", (event) => handle.setPointerCapture(event.pointerId));
  handle.addEventListener("pointermove", (event) => {
    if (handle.hasPointerCapture(event.pointerId)) slide(event);
  });
  handle.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -0.01, ArrowRight: 0.01 }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    change({ swipe: Math.min(1, Math.max(0, state.swipe + step)) });
  });
  const resized = new ResizeObserver(() => change());
  try {
    resized.observe(canvas, { box: "device-pixel-content-box" });
  } catch {
    resized.observe(canvas); // Safari
  }
  // Another screen, or the browser's zoom: the element's size in points may stay.
  const watchRatio = () => {
    const media = matchMedia(`(resolution: ${ratio()}dppx)`);
    media.addEventListener("change", () => { change(); watchRatio(); }, { once: true });
  };
  watchRatio();
})();
