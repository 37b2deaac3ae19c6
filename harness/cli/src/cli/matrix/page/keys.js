// Moving with the keyboard.

// Column -1 is the name of the row.
function targetIn(tr, column) {
  const at = Math.max(0, Math.min(column + 1, tr.children.length - 1));
  return tr.children[at].querySelector("button") ?? tr.querySelector("button");
}

let stop = null; // the only button of the table that Tab reaches
function rove(to) {
  if (stop === to || !to) return;
  if (stop) stop.tabIndex = -1;
  stop = to;
  stop.tabIndex = 0;
}
const home = () => rove(byId("table").querySelector("tbody button"));

function reveal() {
  const entry = selected();
  if (!entry) return;
  // A link to a row that is filtered out still shows its panel. Only its fold is opened.
  if (state.fold.has(entry.module)) change({ fold: toggled(state.fold, entry.module) });
  const target = targetIn(entry.tr, columnNamed(state.column)?.index ?? -1);
  rove(target);
  target.scrollIntoView({ block: "center", inline: "nearest" });
}

function open(entry, column) {
  change({ row: entry.row.name, column }, { step: true });
  if (small.matches) byId("panel-name").focus();
  else targetIn(entry.tr, columnNamed(column)?.index ?? -1).scrollIntoView({ block: "nearest", inline: "nearest" });
}

function closePanel() {
  if (state.row === null) return;
  const entry = selected();
  const target = entry && targetIn(entry.tr, columnNamed(state.column)?.index ?? -1);
  change({ row: null, column: null }, { step: true });
  if (target?.checkVisibility?.() ?? target) target.focus();
  else byId("scroller").focus();
}

const placeOf = (target) => {
  const tr = target.closest("tr");
  const cell = target.closest("th, td");
  return { tr, entry: tr?.entry ?? null, module: tr?.module ?? null, column: cell ? cell.cellIndex - 1 : -1 };
};

function goTo(target, entry, column) {
  rove(target);
  target.focus();
  // An open panel shows the new cell.
  if (state.row !== null && entry) change({ row: entry.row.name, column: entry.row.error ? null : model.columns[column]?.name ?? null });
}

let wish = null; // the column that the up and down keys keep, even if a row lacks it
function moveOn(event) {
  const target = event.target.closest("#table tbody button");
  if (!target || event.altKey || event.metaKey) return;
  const { tr, entry, module, column } = placeOf(target);
  const shown = model.columns.filter(visible).map(({ index }) => index);
  const stops = [-1, ...shown];
  const trs = () => [...byId("table").querySelectorAll("tbody tr:not([hidden])")];
  const across = (to) => goTo(targetIn(tr, to), entry, to);
  const down = (list, to) => {
    const next = list[Math.max(0, Math.min(to, list.length - 1))];
    if (!next) return;
    const keep = wish ?? column;
    goTo(targetIn(next, keep), next.entry, keep);
    wish = keep;
  };
  const step = { ArrowDown: 1, ArrowUp: -1, PageDown: 10, PageUp: -10 }[event.key];
  if (step) {
    const list = trs();
    wish ??= module || entry?.row.error ? null : column;
    down(list, list.indexOf(tr) + step);
  } else if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
    wish = null;
    const by = event.key === "ArrowLeft" ? -1 : 1;
    if (module) {
      if (state.fold.has(module.name) === (by > 0)) change({ fold: toggled(state.fold, module.name) }, { step: true });
    } else if (!entry.row.error) across(stops[Math.max(0, Math.min(stops.indexOf(column) + by, stops.length - 1))]);
  } else if (event.key === "Home" || event.key === "End") {
    const last = event.key === "End";
    if (event.ctrlKey) {
      const list = trs();
      down(list, last ? list.length - 1 : 0);
    } else if (!module && !entry.row.error) {
      wish = null;
      across(last ? stops.at(-1) : -1);
    }
  } else if (event.key === "Enter" && entry && marked?.button === target && state.row !== null) {
    byId("panel-name").focus();
  } else return;
  event.preventDefault();
}

function listen() {
  const table = byId("table");
  table.addEventListener("click", (event) => {
    const target = event.target.closest("tbody button");
    if (!target) return;
    const { entry, module, column } = placeOf(target);
    rove(target);
    wish = null;
    if (module) change({ fold: toggled(state.fold, module.name) }, { step: true });
    else open(entry, model.columns[column]?.name ?? null);
  });
  table.addEventListener("keydown", moveOn);
  table.addEventListener("focusin", (event) => rove(event.target.closest("tbody button")));
  const filter = byId("filter");
  let timer = null;
  filter.addEventListener("input", () => {
    clearTimeout(timer);
    timer = setTimeout(() => change({ filter: filter.value }), 60);
  });
  byId("because-off").onclick = () => change({ reason: null }, { step: true });
  byId("choose-all").onclick = () => change({ columns: null }, { step: true });
  byId("fold-all").onclick = () => change({ fold: new Set(model.modules.map(({ name }) => name)) }, { step: true });
  byId("unfold-all").onclick = () => change({ fold: new Set() }, { step: true });
  byId("reset").onclick = () => {
    filter.value = "";
    change({ filter: "", show: new Set(), kinds: new Set(), columns: null, reason: null }, { step: true });
    filter.focus();
  };
  const help = () => byId("help").showModal();
  byId("help-open").onclick = help;
  byId("words").append(...[...SORTS].flatMap(([sort, { about }]) => [element("dt", {}, badge(sort)), element("dd", {}, about)]),
    element("dt", {}, "✓ref ✗ref"), element("dd", {}, "the package's own tests accept or reject its results against their references on this path"),
    element("dt", {}, "not compared"), element("dd", {}, "the column runs on this machine, but no results are compared with this row's; or the row is in no column"));
  byId("panel-close").onclick = closePanel;
  const aside = (by) => () => {
    const shown = model.columns.filter(visible);
    const at = shown.findIndex(({ name }) => name === state.column);
    const next = shown[(at + by + shown.length) % shown.length];
    if (next) change({ column: next.name });
  };
  byId("panel-before").onclick = aside(-1);
  byId("panel-after").onclick = aside(1);
  byId("copy-command").onclick = (event) => copy(commandOf(selected(), columnNamed(state.column).head.language), event.currentTarget);
  byId("copy-link").onclick = (event) => copy(location.href.split("#")[0] + address(), event.currentTarget);
  document.addEventListener("click", (event) => {
    if (!event.target.closest("#choose")) byId("choose").open = false;
  });
  document.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || byId("help").open) return;
    const typing = event.target.matches?.("input:not([type=checkbox]), textarea");
    if (event.key === "Escape") {
      if (byId("choose").open) byId("choose").open = false;
      else if (typing && filter.value) {
        filter.value = "";
        change({ filter: "" });
      } else closePanel();
    } else if (typing) {
      if (event.key === "ArrowDown" || event.key === "Enter") stop?.focus();
      else return;
    } else if (event.key === "/") {
      filter.focus();
      filter.select();
    } else if (event.key === "?") help();
    else return;
    event.preventDefault();
  });
  window.addEventListener("hashchange", follow);
  window.addEventListener("popstate", follow);
  small.addEventListener("change", drawPanel);

  // Elements that stick below the tools need the height of the tools.
  new ResizeObserver(() => {
    document.documentElement.style.setProperty("--tools-height", `${byId("tools").offsetHeight}px`);
  }).observe(byId("tools"));

  const grip = byId("grip");
  const raise = (percent) => {
    const height = Math.round(Math.max(20, Math.min(90, percent)));
    document.documentElement.style.setProperty("--panel-height", `${height}vh`);
    grip.setAttribute("aria-valuenow", String(height));
  };
  grip.addEventListener("pointerdown", (event) => {
    grip.setPointerCapture(event.pointerId);
    grip.onpointermove = ({ clientY }) => raise(100 - (100 * clientY) / innerHeight);
  });
  grip.addEventListener("lostpointercapture", () => { grip.onpointermove = null; });
  grip.addEventListener("keydown", (event) => {
    const by = { ArrowUp: 5, ArrowDown: -5 }[event.key];
    if (!by) return;
    raise(Number(grip.getAttribute("aria-valuenow")) + by);
    event.preventDefault();
  });
  window.addEventListener("beforeprint", () => document.querySelectorAll(".about").forEach((about) => { about.open = true; }));
}
