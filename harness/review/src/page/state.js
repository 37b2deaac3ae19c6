// The shown case, and the settings of the view, as one object. To change it, call `change`. Before the next frame, each
// part of the page that depends on the object is updated once.

const index = JSON.parse(document.getElementById("index").textContent);

const CHANNELS = ["RGB", "R", "G", "B", "A", "luminance"];
// Folders follow the files beside them, and numbers are sorted by value: f2 is before f10. Names that differ only in
// zeros have an order, too.
const collator = new Intl.Collator("en", { numeric: true });
const compare = (a, b) => collator.compare(a, b) || Number(a > b) - Number(a < b);
const folderOf = (name) => name.slice(0, name.lastIndexOf("/") + 1);
const inOrder = ({ name: a }, { name: b }) => compare(folderOf(a), folderOf(b)) || compare(a, b);

const KINDS = ["pending", "function", "golden"]; // in the order of the list

const VIEWS = ["side", "golden", "actual", "swipe", "flip", "difference", "map"];

const state = {
  // Unusable files have no data, and show the reason.
  cases: [
    ...index.cases.map((entry) => ({ ...entry, severity: entry.severity === "inf" ? Infinity : entry.severity, data: null }))
      .sort((a, b) => KINDS.indexOf(a.status) - KINDS.indexOf(b.status) || inOrder(a, b)),
    ...index.unusable.map((entry) => ({ ...entry, index: null, status: "unusable", data: null })).sort(inOrder),
  ],
  selected: 0, // the position; -1 means none
  absent: null, // the name in the address, if no case has this name
  filter: "",
  sort: "name", // or "error": the largest ratio to the tolerance first
  sheet: false, // thumbnails of all frames, in place of one frame
  chosen: new Set(), // the entries for a common decision
  view: "side",
  more: false, // the whole toolbar, on screens where it is folded
  part: 0,
  map: 0,
  channel: 0,
  exposure: 0, // stops
  tone: 0,
  falseColor: false,
  marks: true,
  grid: false,
  relative: true, // differences divided by the golden, as the test judges them
  gain: 0, // stops
  gainAuto: true, // until you choose a gain
  how: 0, // the colours of differences: an index in tones.differences
  outlines: true, // around failing areas
  values: true, // numbers on pixels that are large enough
  hz: 3, // changes per second
  flipping: false,
  phase: 0, // the visible side of flip: 0 golden, 1 frame
  swipe: 0.5, // the golden's share of the pane
  scale: 1, // pixels of the screen per texel
  center: [0, 0], // the texel in the middle of each pane
  fit: true, // until you zoom
  hover: null, // the texel under the cursor
  pinned: null, // the pinned texel
};

const listeners = [];
let announced = false;

function change(changes = {}) {
  Object.assign(state, changes);
  if (announced) return;
  announced = true;
  requestAnimationFrame(() => {
    announced = false;
    listeners.forEach((listener) => listener());
  });
}

const selectedCase = () => state.cases[state.selected];
// Returns the positions of the cases whose names contain each word of the filter.
function listed() {
  const words = state.filter.toLowerCase().split(/\s+/);
  const has = ({ name }) => words.every((word) => name.toLowerCase().includes(word));
  const positions = [...state.cases.keys()].filter((position) => has(state.cases[position]));
  if (state.sort === "name") return positions;
  // Unusable files aren't frames, so they come last. The sort is stable.
  const rank = ({ status, severity }) => ({ unusable: -1, golden: -2 })[status] ?? severity ?? 0;
  return positions.sort((a, b) => rank(state.cases[b]) - rank(state.cases[a]));
}

const loaded = () => selectedCase()?.data ?? null;
const part = () => loaded()?.parts?.[state.part] ?? null;
const inspected = () => state.pinned ?? state.hover;

// Returns the size of the shown case: the larger of both sides.
function extent() {
  const sides = [part()?.golden, part()?.actual].filter(Boolean);
  return [Math.max(1, ...sides.map((s) => s.width)), Math.max(1, ...sides.map((s) => s.height))];
}

// Returns the four values of an image at a texel, or null outside of the image.
function texel(image, at) {
  if (!image || !at) return null;
  const [x, y] = at;
  if (x < 0 || y < 0 || x >= image.width || y >= image.height) return null;
  const start = 4 * (y * image.width + x);
  return image.values.subarray(start, start + 4);
}

// Makes an element: `element("td", { className: "number" }, "1.5")`.
function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

const byId = (id) => document.getElementById(id);
