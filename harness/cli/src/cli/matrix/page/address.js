// The state of the page, in its address.

const fresh = () => ({
  package: null, filter: "", show: new Set(), kinds: new Set(),
  columns: null, // the names of the shown columns; null means all
  fold: new Set(), row: null, column: null, reason: null,
});
let state = fresh();
let model = null;
let models = [];
let saving = null; // the timer of the next change of the address
let known = location.hash; // the fragment that the page has followed or written

const encode = (text) => encodeURIComponent(text).replace(/%3A/g, ":").replace(/%2F/g, "/");
const decode = (text) => {
  try {
    return decodeURIComponent(text);
  } catch {
    return text; // typed by hand: its % isn't an escape
  }
};

function address() {
  const parts = [];
  const put = (name, value) => value && parts.push(`${name}=${value}`);
  if (models.length > 1) put("package", encode(state.package));
  put("filter", encode(state.filter));
  put("show", [...state.show].map(encode).join(","));
  put("kind", [...state.kinds].map(encode).join(","));
  if (state.columns) put("columns", [...state.columns].map(encode).join(",") || ",");
  const all = model && model.modules.length > 1 && model.modules.every(({ name }) => state.fold.has(name));
  put("fold", all ? "*" : [...state.fold].map((name) => encode(name) || "-").join(","));
  put("reason", state.reason && encode(state.reason));
  put("row", state.row !== null && encode(state.row));
  put("column", state.column !== null && encode(state.column));
  return `#${parts.join("&")}`;
}

function follow() {
  clearTimeout(saving);
  known = location.hash;
  const asked = new Map(location.hash.slice(1).split("&").filter(Boolean).map((part) => {
    const cut = part.indexOf("=");
    return cut < 0 ? [decode(part), ""] : [decode(part.slice(0, cut)), part.slice(cut + 1)];
  }));
  const list = (name) => (asked.get(name) ?? "").split(",").filter(Boolean).map(decode);
  const one = (name) => (asked.has(name) ? decode(asked.get(name)) : null);
  const wanted = models.find(({ matrix }) => matrix.package === one("package")) ??
    models.find(({ byName }) => byName.has(one("row"))) ?? models[0];
  state = {
    package: wanted.matrix.package,
    filter: one("filter") ?? "",
    show: new Set(list("show")),
    kinds: new Set(list("kind")),
    columns: asked.has("columns") ? new Set(list("columns")) : null,
    fold: new Set(asked.get("fold") === "*" ? wanted.modules.map(({ name }) => name) : list("fold").map((name) => (name === "-" ? "" : name))),
    row: one("row"),
    column: one("column"),
    reason: one("reason"),
  };
  draw();
  byId("filter").value = state.filter;
  if (state.row !== null) reveal();
}

// With `step`, the browser's back button undoes the change. Moving and typing don't add steps.
function change(changes, { step = false } = {}) {
  Object.assign(state, changes);
  draw();
  clearTimeout(saving);
  const save = () => {
    const to = address();
    // If the fragment isn't the known one, the reader has just typed it. The event for it follows, and takes precedence.
    if (location.hash !== known || to === (location.hash || "#")) return;
    try {
      // An address without a fragment keeps the page's own fragment.
      history[step ? "pushState" : "replaceState"](null, "", to);
      known = location.hash;
    } catch {
      // Some viewers of artefacts forbid this. Then only the link is lost.
    }
  };
  if (step) save();
  else saving = setTimeout(save, 250);
}
