// The tools above the table.

const SHOWS = new Map(Object.entries({
  differs: { label: "DIFFERS" },
  invalid: { label: "INVALID" },
  panics: { label: "PANICS" },
  broke: { label: "NO VERDICT" },
  unsupported: { label: "unsupported" },
  reference: { label: "reference fails" },
  known: { label: "known" },
  open: { label: "not compared", about: "Rows that aren't compared in a column that runs here, and rows in no column. The number counts cells" },
}));

const toggled = (set, value) => {
  const made = new Set(set);
  if (!made.delete(value)) made.add(value);
  return made;
};

let toggles = []; // each function updates the state of its button
function buildTools() {
  toggles = [];
  const counts = new Map();
  for (const { row, cells } of model.rows) {
    if (row.error) counts.set("open", (counts.get("open") ?? 0) + 1);
    cells.forEach((cell) => cell?.classes.forEach((name) => counts.set(name, (counts.get(name) ?? 0) + 1)));
  }
  const toggle = (label, pressed, next, title = "") => {
    const made = button({ title, onclick: () => change(next(), { step: true }) }, label);
    toggles.push(() => made.setAttribute("aria-pressed", String(pressed())));
    return made;
  };
  const findings = FINDINGS.filter((name) => counts.has(name));
  const all = () => findings.length > 0 && state.show.size === findings.length && findings.every((name) => state.show.has(name));
  byId("show").replaceChildren(
    toggle("All", () => state.show.size === 0, () => ({ show: new Set() }), "Rows with any cells"),
    ...(findings.length > 1 ? [toggle(`Findings ${findings.reduce((sum, name) => sum + counts.get(name), 0)}`, all, () => ({ show: new Set(all() ? [] : findings) }), "Rows with a cell that is wrong")] : []),
    ...[...SHOWS].filter(([name]) => counts.has(name)).map(([name, { label, about = "The number counts cells" }]) =>
      toggle(`${SORTS.has(name) ? `${signOf(name)} ` : ""}${label} ${counts.get(name)}`, () => state.show.has(name), () => ({ show: toggled(state.show, name) }), about)));
  const kinds = new Map();
  model.rows.forEach(({ kind }) => kinds.set(kind, (kinds.get(kind) ?? 0) + 1));
  byId("kinds").hidden = kinds.size < 2;
  byId("kinds").replaceChildren(...[...kinds].map(([kind, count]) =>
    toggle(`${plain(kind)} ${count}`, () => state.kinds.has(kind), () => ({ kinds: toggled(state.kinds, kind) }), "The number counts rows")));
  byId("choices").replaceChildren(...model.columns.map((column) => {
    const box = element("input", { type: "checkbox" });
    box.addEventListener("change", () => {
      const chosen = new Set(model.columns.filter((one) => (one === column ? box.checked : visible(one))).map(({ name }) => name));
      change({ columns: chosen.size === model.columns.length ? null : chosen }, { step: true });
    });
    toggles.push(() => { box.checked = visible(column); });
    return element("label", {}, box, ` ${plain(column.name)} `, element("span", { className: "dim" }, plain(column.head.language)));
  }));
}
