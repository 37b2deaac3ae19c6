// The toolbar and the keys. Each control shows the state and changes it.

const actions = (() => {
  const stops = (by) => change({ exposure: Math.round((state.exposure + by) * 4) / 4 });
  const reset = () => change({ fit: true, pinned: null });

  // Shows pixels 1:1 around the inspected pixel, or around the middle. If they are 1:1 already, shows the whole image.
  const pixels = () => {
    if (!state.fit && state.scale === 1) return reset();
    return change({ scale: 1, fit: false, center: inspected() ?? state.center });
  };

  // Puts the image's key at middle grey, as in previews. The exposure is a whole number of stops, so that values stay
  // readable.
  const autoExposure = () => {
    const image = part()?.golden ?? part()?.actual;
    if (image) change({ exposure: Math.round(Math.log2(0.18 / image.key)) });
  };

  const select = (selected) => {
    if (selected !== state.selected) stage.forget?.(imagesOf(selectedCase()));
    change({ selected, absent: null, part: 0, map: 0, fit: true, pinned: null, hover: null, gainAuto: true });
    if (selectedCase()) load(selectedCase());
  };

  // Goes to the next listed case, forward or back from a position, and stays at the end. From an unlisted position it
  // goes to the first or the last case.
  const step = (by, from = state.selected) => {
    const positions = listed();
    const at = positions.indexOf(from);
    if (at >= 0) {
      if (positions[at + by] !== undefined) select(positions[at + by]);
      return;
    }
    const following = by > 0
      ? positions.find((position) => position > from)
      : positions.findLast((position) => position < from);
    if (following !== undefined) select(following);
  };

  const imagesOf = (entry) => [
    ...(entry?.data?.parts ?? []).flatMap(({ golden, actual }) => [golden, actual]),
    ...(entry?.data?.maps ?? []).map(({ image }) => image),
  ];

  // Goes to the worst pixel that the test found. With `by`, goes to the next failing area.
  const worst = (by = 0) => {
    const boxes = failing.of(loaded())?.boxes ?? [];
    const place = loaded()?.gates.find((gate) => gate.place)?.place;
    if (!by && place) return lookAt(place);
    if (!boxes.length) return undefined;
    const inside = ({ left, top, right, bottom }, [x, y]) => x >= left && x <= right && y >= top && y <= bottom;
    const now = state.pinned ? boxes.findIndex((box) => inside(box, state.pinned)) : -1;
    const box = boxes[by ? (now + by + boxes.length) % boxes.length : 0];
    return box.whole ? lookAt([...box.at, ...box.at]) : lookAt([box.left, box.top, box.right, box.bottom], box.at);
  };

  const show = (view) => change({ view, flipping: view === "flip", sheet: false });

  return { stops, reset, pixels, autoExposure, select, step, worst, show };
})();

const keys = (() => {
  const button = (id, act) => byId(id).addEventListener("click", (event) => {
    act();
    // A click leaves no focus, so that the space bar flips. The focus of the keyboard stays.
    if (event.detail) event.currentTarget.blur();
  });
  const toggles = { "false-color": "falseColor", marks: "marks", grid: "grid", relative: "relative",
    outlines: "outlines", "show-values": "values" };
  for (const [id, name] of Object.entries(toggles)) {
    button(id, () => {
      change({ [name]: !state[name] });
      if (name === "relative") change({ gainAuto: true }); // the unit of the gain changes
    });
  }
  for (const view of VIEWS) button(`view-${view}`, () => actions.show(view));
  button("exposure-auto", actions.autoExposure);
  button("exposure-zero", () => change({ exposure: 0 }));
  button("gain-auto", () => change({ gainAuto: true }));
  button("gain-less", () => gain.by(-1));
  button("gain-more", () => gain.by(1));
  button("fit", actions.reset);
  button("one-to-one", actions.pixels);
  button("sort", () => change({ sort: state.sort === "name" ? "error" : "name" }));
  button("sheet-open", () => change({ sheet: !state.sheet }));
  button("tools-more", () => change({ more: !state.more }));
  button("help-open", () => byId("help").showModal());

  const exposures = [byId("exposure"), byId("exposure-value")];
  exposures.forEach((input) => input.addEventListener("input", () => {
    const exposure = input.valueAsNumber;
    if (Number.isFinite(exposure)) change({ exposure });
  }));
  const menu = (id, name, options) => {
    const list = byId(id);
    list.replaceChildren(...options.map((text, value) => element("option", { value }, text)));
    list.addEventListener("change", () => change({ [name]: Number(list.value) }));
  };
  menu("tone", "tone", tones.all.map(({ name }) => name));
  menu("how", "how", tones.differences);
  menu("channel", "channel", CHANNELS);
  menu("part", "part", []);
  menu("map", "map", []);
  byId("hz").addEventListener("input", (event) => change({ hz: event.target.valueAsNumber }));

  const refill = (list, names, chosen) => {
    if (list.options.length !== names.length || names.some((name, i) => list.options[i].text !== name)) {
      list.replaceChildren(...names.map((text, value) => element("option", { value }, text)));
    }
    list.value = String(chosen);
  };

  let viewed = state.view;
  listeners.push(() => {
    for (const [id, name] of Object.entries(toggles)) byId(id).setAttribute("aria-pressed", String(state[name]));
    for (const view of VIEWS) byId(`view-${view}`).setAttribute("aria-pressed", String(state.view === view));
    if (state.view !== viewed) byId(`view-${state.view}`).scrollIntoView({ block: "nearest", inline: "nearest" });
    viewed = state.view;
    for (const input of exposures) if (input !== document.activeElement || input.valueAsNumber !== state.exposure) input.value = state.exposure;
    byId("tools-more").setAttribute("aria-expanded", String(state.more));
    byId("tools").classList.toggle("more", state.more);
    byId("tone").value = String(state.tone);
    byId("channel").value = String(state.channel);
    byId("how").value = String(state.how);
    byId("gain-value").textContent = gain.text();
    byId("gain-auto").setAttribute("aria-pressed", String(state.gainAuto));
    byId("hz-value").textContent = `${state.hz} a second`;
    byId("zoom").textContent = loaded() ? `${numbers.rounded(100 * state.scale)} %` : "";
    byId("for-difference").hidden = state.view !== "difference";
    byId("for-flip").hidden = state.view !== "flip";
    const maps = loaded()?.maps ?? [];
    const parts = loaded()?.parts ?? [];
    byId("for-map").hidden = state.view !== "map" || maps.length < 1;
    byId("view-map").disabled = maps.length < 1;
    const alone = selectedCase()?.status === "golden" && !part()?.version; // there is nothing to compare with
    for (const view of ["actual", "swipe", "flip", "difference"]) byId(`view-${view}`).disabled = alone;
    byId("for-part").hidden = parts.length < 2;
    refill(byId("map"), maps.map(({ name }) => name), state.map);
    refill(byId("part"), parts.map(({ name }) => name), state.part);
    byId("map-about").textContent = maps[state.map]?.about ?? "";
  });

  // Flipping has its own timer, which restarts when the rate changes.
  let timer = null;
  let rate = null;
  listeners.push(() => {
    const wanted = state.view === "flip" && state.flipping ? state.hz : null;
    if (wanted === rate) return;
    rate = wanted;
    clearInterval(timer);
    if (rate) timer = setInterval(() => change({ phase: 1 - state.phase }), 1000 / rate);
  });

  const cycle = (name, count, by = 1) => change({ [name]: (state[name] + by + count) % count });
  const move = (dx, dy) => {
    if (state.pinned) {
      const [width, height] = extent();
      const [x, y] = state.pinned;
      return change({ pinned: [Math.min(width - 1, Math.max(0, x + dx)), Math.min(height - 1, Math.max(0, y + dy))] });
    }
    const step = 64 / state.scale;
    return change({ center: [state.center[0] + dx * step, state.center[1] + dy * step], fit: false });
  };
  // The space bar is for comparing by eye: it starts flipping, and stops at the visible side.
  const flip = () => (state.view === "flip"
    ? change({ flipping: !state.flipping })
    : actions.show("flip"));

  const KEYS = {
    j: () => actions.step(1),
    k: () => actions.step(-1),
    "/": () => { byId("filter").focus(); byId("filter").select(); },
    1: () => actions.show("golden"),
    2: () => actions.show("actual"),
    3: () => actions.show("difference"),
    4: () => actions.show("side"),
    5: () => actions.show("swipe"),
    6: () => (state.view === "map" ? cycle("map", loaded()?.maps.length || 1) : actions.show("map")),
    " ": flip,
    e: () => actions.stops(1),
    E: () => actions.stops(-1),
    0: () => change({ exposure: 0 }),
    x: actions.autoExposure,
    m: () => cycle("tone", tones.all.length),
    f: () => change({ falseColor: !state.falseColor }),
    c: () => cycle("channel", CHANNELS.length),
    C: () => cycle("channel", CHANNELS.length, -1),
    n: () => change({ marks: !state.marks }),
    t: () => change({ grid: !state.grid }),
    z: actions.pixels,
    Z: actions.reset,
    "+": () => zoom(2),
    "=": () => zoom(2),
    "-": () => zoom(0.5),
    w: () => actions.worst(),
    W: () => actions.worst(1),
    "[": () => gain.by(-1),
    "]": () => gain.by(1),
    g: () => change({ gainAuto: true }),
    d: () => (state.view === "difference" ? cycle("how", tones.differences.length) : actions.show("difference")),
    o: () => change({ outlines: !state.outlines }),
    v: () => change({ values: !state.values }),
    s: () => change({ sheet: !state.sheet }),
    Enter: () => { if (state.sheet) change({ sheet: false }); },
    l: () => change({ sort: state.sort === "name" ? "error" : "name" }),
    y: () => choose.toggle(state.selected),
    Y: () => choose.all(),
    h: histogram.toggle,
    a: () => decide.open("accept"),
    r: () => decide.open("reject"),
    "?": () => byId("help").showModal(),
    Escape: () => {
      if (state.sheet) change({ sheet: false });
      else if (state.pinned) change({ pinned: null });
      else if (state.filter) change({ filter: "" });
      else choose.none();
    },
    ArrowLeft: () => move(-1, 0),
    ArrowRight: () => move(1, 0),
    ArrowUp: () => move(0, -1),
    ArrowDown: () => move(0, 1),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    const { target } = event;
    if (target.matches("select, textarea, input:not([type=range])")) return;
    if (target.matches("button, [type=range]") && [" ", "Enter"].includes(event.key)) return;
    if (target.matches("[type=range]") && event.key.startsWith("Arrow")) return;
    const act = KEYS[event.key];
    if (!act || (!stage.gl && !["j", "k", "l", "s", "y", "Y", "a", "r", "/", "?", "Escape"].includes(event.key))) return;
    event.preventDefault();
    act();
  });

  return Object.keys(KEYS);
})();
