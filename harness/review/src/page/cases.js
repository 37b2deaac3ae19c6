// The list of cases, and their data: each script passes one case to the page.

// Loads a case's data once.
function load(entry) {
  if (entry.data || entry.loading || entry.index === null) return;
  entry.loading = true;
  const script = element("script", { src: `data/${entry.index}.js`, async: true });
  script.addEventListener("error", () => {
    entry.loading = false;
    entry.error = index.served
      ? "The frame can't be loaded: is `karat review` still running?"
      : `The frame can't be loaded: data/${entry.index}.js isn't beside this page.`;
    change();
  });
  script.addEventListener("load", () => script.remove());
  document.head.append(script);
}

// Receives the call of a data file.
async function receive(data) {
  const entry = state.cases.find(({ index: number }) => number === data.index);
  if (!entry) return;
  if (data.version) {
    await versions.received(entry, data);
    return;
  }
  try {
    if (data.error) throw new Error(data.error);
    received(entry, { ...data, ...await images(data) });
  } catch (error) {
    Object.assign(entry, { error: error.message, background: false });
  }
  entry.loading = false;
  change();
}

async function images(data) {
  if (data.function) return { parts: [], maps: [], gates: [], facts: [] };
  const made = async (stored, golden) => stored && prepared(await numbers.image(stored, golden));
  const parts = await Promise.all(data.parts.map(async ({ name, golden: stored, actual }) => {
    const golden = await made(stored);
    return { name, golden, actual: await made(actual, golden) };
  }));
  const grey = ({ values }) => values.every((value, i) => i % 4 === 0 || i % 4 === 3 || value === values[i - (i % 4)]);
  const maps = await Promise.all(data.maps.map(async (map) => {
    const image = await made(map.image);
    return { ...map, image, scalar: grey(image) };
  }));
  for (const image of [...parts.flatMap(({ golden, actual }) => [golden, actual]), ...maps.map(({ image }) => image)]) {
    if (image) delete image.words;
  }
  return { parts, maps };
}

function received(entry, data) {
  Object.assign(entry, { data: { ...data, refused: undefined }, pixels: data.pixels, size: entry.size ?? data.size, error: null });
  thumbs.make(entry);
  // Data that was loaded only for a thumbnail isn't kept.
  if (entry.background && entry !== selectedCase()) entry.data = null;
  entry.background = false;
}

// Adds the key, which is the logarithmic mean of luminance, and the luminance below which a pixel counts as dark. This
// luminance is the same share of the key as in the comparison of frames.
function prepared(image) {
  const { values } = image;
  let [sum, count] = [0, 0];
  for (let i = 0; i < values.length; i += 4) {
    const light = 0.2126 * values[i] + 0.7152 * values[i + 1] + 0.0722 * values[i + 2];
    if (light > 1.1754944e-38 && light < Infinity) { // normal f32
      sum += Math.log(light);
      count += 1;
    }
  }
  const key = count ? Math.exp(sum / count) : 1;
  return Object.assign(image, { key, dark: 1e-4 * key });
}

(() => {
  const list = byId("cases");
  const filter = byId("filter");
  const MANY = 12; // with more entries, the filter is useful
  const UNUSABLE = "can't be used";
  const STATUS = { accepted: "accepted", rejected: "rejected", gone: "no longer pending" };

  // Returns the ratio to the frame's tolerance. Empty for a new or decided frame.
  const severity = ({ severity: times, status }) => (times == null || !["pending", "function"].includes(status) ? ""
    : times === Infinity ? "∞" : `${numbers.rounded(times)} ×`);
  const badges = ({ odd, finite, status }) => (status !== "pending" ? []
    : [...(finite === false || odd?.nan ? ["NaN"] : []), ...(odd?.size ? ["size"] : [])]);

  const size = (entry) => (entry?.table && entry.size ? `${entry.size[1]} rows` : entry?.size?.join(" × ") ?? "");
  const GROUPS = { unusable: UNUSABLE, golden: "accepted goldens", function: "failing functions" };
  const groupOf = (entry) => GROUPS[entry.status] ?? folderOf(entry.name);

  // A long name may break after its parts. Browsers also break it after hyphens.
  const breakable = (name) => name.match(/[^/_.]+[/_.]*|[/_.]+/g).flatMap((piece) => [piece, element("wbr")]);

  const row = (position) => {
    const entry = state.cases[position];
    const unusable = entry.status in GROUPS; // these entries are together, with their whole names
    const status = STATUS[entry.status] ?? (entry.new ? "new" : "");
    const name = unusable || state.sort === "error" ? entry.name : entry.name.slice(groupOf(entry).length);
    const marked = status || severity(entry) || badges(entry).length;
    const button = element("button", { type: "button", className: entry.status },
      ...(entry.thumb ? [thumbs.copy(entry.thumb.actual ?? entry.thumb.golden, "thumb")] : entry.index === null || entry.table || entry.status === "function" ? [] : [element("span", { className: "thumb" })]),
      element("span", { className: marked ? "name" : "name alone" }, ...breakable(name)),
      element("span", { className: "marks" },
        ...badges(entry).map((text) => element("span", { className: "badge" }, text)),
        element("span", { className: "severity" }, severity(entry)),
        element("span", { className: "status" }, status)));
    button.title = [entry.name, size(entry), unusable ? GROUPS[entry.status] : status, ...badges(entry),
      severity(entry) && `${severity(entry)} its tolerance`].filter(Boolean).join(", ");
    button.setAttribute("aria-current", String(position === state.selected));
    button.addEventListener("click", (event) => {
      actions.select(position);
      if (event.detail) document.activeElement?.blur();
    });
    return element("li", {}, ...choose.box(position), button);
  };

  // Each folder has one heading above its frames. If frames are sorted by error, there are no headings.
  const folders = (positions) => {
    if (state.sort === "error") return [element("li", {}, element("ol", {}, ...positions.map(row)))];
    const members = new Map();
    for (const position of positions) {
      const name = groupOf(state.cases[position]);
      if (!members.has(name)) members.set(name, []);
      members.get(name).push(row(position));
    }
    return [...members].map(([name, rows]) => element("li", {},
      ...(name ? [element("div", { className: "folder" }, name)] : []),
      element("ol", {}, ...rows)));
  };

  let shown = "";
  listeners.push(() => {
    const now = JSON.stringify([state.selected, state.filter, state.sort, [...state.chosen],
      state.cases.map(({ status, size: known, thumb, odd }) => [status, Boolean(known), Boolean(thumb), odd])]);
    if (now === shown) return;
    shown = now;
    const focused = list.contains(document.activeElement);
    const positions = listed();
    list.replaceChildren(...folders(positions));
    const current = list.querySelector("[aria-current=true]");
    current?.scrollIntoView({ block: "nearest" });
    if (focused) current?.focus();
    byId("find").hidden = state.cases.length <= MANY;
    if (filter.value !== state.filter) filter.value = state.filter;
    byId("found").textContent = state.filter ? `${positions.length} of ${state.cases.length}` : "";
    const place = positions.indexOf(state.selected);
    byId("position").textContent = place < 0 ? "" : `${place + 1} of ${positions.length}`;
    byId("sort").textContent = `By ${state.sort}`;
    byId("none-found").hidden = positions.length > 0 || !state.cases.length;
    const left = state.cases.filter(({ status }) => status === "pending").length;
    byId("count").textContent = left ? `${left} pending` : "nothing to review";
    const entry = selectedCase();
    byId("name").textContent = entry?.name ?? "";
    byId("size").textContent = size(entry);
    document.title = entry ? `${entry.name} – Karat review` : "Karat review";
  });

  filter.addEventListener("input", () => change({ filter: filter.value }));
  filter.addEventListener("keydown", (event) => {
    const keys = {
      Escape: () => { change({ filter: "" }); filter.blur(); },
      Enter: () => {
        if (!listed().includes(state.selected)) actions.step(1, -1);
        filter.blur();
      },
      ArrowDown: () => actions.step(1),
      ArrowUp: () => actions.step(-1),
    };
    if (!keys[event.key] || event.isComposing) return;
    event.preventDefault();
    keys[event.key]();
  });
})();
