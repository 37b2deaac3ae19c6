// The shown rows and columns.

const visible = ({ name }) => !state.columns || state.columns.has(name);

// Returns the words of the filter. Words in quotes are one search text.
const words = () => [...state.filter.toLowerCase().matchAll(/"([^"]+)"?|([^\s"]+)/g)].map((m) => m[1] ?? m[2]).slice(0, 30);

function sift() {
  const wanted = words();
  const all = (1 << wanted.length) - 1;
  const masks = model.texts.map((text) => wanted.reduce((mask, word, bit) => (text.includes(word) ? mask | (1 << bit) : mask), 0));
  const columns = model.columns.filter(visible);
  const reason = state.reason && (model.reasons.find(({ id }) => id === state.reason) ?? "none");
  // One cell must have all requested properties, together with the row's name.
  const passes = (entry) => {
    if (state.kinds.size && !state.kinds.has(entry.kind)) return false;
    const own = masks[entry.text];
    if (!state.show.size && !reason && own === all) return true;
    if (entry.row.error) return own === all && (!state.show.size || state.show.has("open")) && (!reason || entry.reason === reason);
    return columns.some(({ index }) => {
      const cell = entry.cells[index];
      return cell && (own | masks[cell.text]) === all && (!reason || cell.reason === reason) &&
        (!state.show.size || cell.classes.some((name) => state.show.has(name)));
    });
  };
  let count = 0;
  for (const module of model.modules) {
    module.shown = 0;
    const folded = state.fold.has(module.name);
    for (const entry of module.rows) {
      const passed = passes(entry);
      if (passed) module.shown += 1;
      entry.shown = passed && !folded;
      if (entry.tr.hidden === entry.shown) entry.tr.hidden = !entry.shown;
    }
    count += module.shown;
    const { header } = module;
    header.tr.hidden = module.shown === 0;
    // Estimates the height of rows that aren't drawn yet.
    header.tr.parentNode.hidden = module.shown === 0;
    header.tr.parentNode.style.setProperty("--lines", folded ? 1 : 1 + module.shown);
    header.button.setAttribute("aria-expanded", String(!folded));
    header.sign.textContent = folded ? "▸" : "▾";
    header.count.textContent = module.shown === module.rows.length ? many(module.shown, "row") : `${module.shown} of ${many(module.rows.length, "row")}`;
  }
  return { count, reason };
}
