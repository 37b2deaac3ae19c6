// The model of the page.

const NOT_CALLABLE = "not callable";

// Combines reasons that differ only in numbers, inputs and the name of the row.
function shape(stop) {
  let text = plain(stop.says).trim();
  if (stop.why === "differs") text = text.split(": at ")[0];
  return `${stop.why} ${text.replace(/`[^`\n]*::[^`\n]*`/g, "`…`").replace(/-->[^\n]*/g, "-->").replace(/\d[\d.]*/g, "#")}`;
}

// Returns a short name of a text, for addresses (FNV-1a).
function digest(text) {
  let hash = 0x811c9dc5;
  for (let i = 0; i < text.length; i += 1) hash = Math.imul(hash ^ text.charCodeAt(i), 0x01000193);
  return (hash >>> 0).toString(16).padStart(8, "0");
}

function modelOf(matrix) {
  const columns = matrix.columns.map((head, index) => ({ head, index, name: String(head.name) }));
  const texts = new Map(); // the text of each cell for the filter, without duplicates
  const intern = (text) => texts.get(text) ?? (texts.set(text, texts.size), texts.size - 1);
  const reasons = new Map();
  const modules = new Map();
  const blame = (key, why, says, entry, column, classes) => {
    if (!reasons.has(key)) reasons.set(key, { id: digest(key), why, says, classes: new Set(), rows: new Map(), columns: new Map(), variants: new Set(), cells: 0 });
    const reason = reasons.get(key);
    if (!reason.rows.has(entry)) reason.rows.set(entry, column);
    if (column) reason.columns.set(column.name, (reason.columns.get(column.name) ?? 0) + 1);
    reason.variants.add(says);
    reason.cells += 1;
    classes.forEach((name) => reason.classes.add(name));
    return reason;
  };
  const rows = matrix.rows.map((row, index) => {
    const module = moduleOf(row.name);
    const kind = row.error ? NOT_CALLABLE : String(row.kind);
    const entry = { row, index, module, kind, cells: [], reason: null, tr: null, shown: true };
    entry.text = intern(`${row.name} ${kind} ${row.kind} ${row.location ?? ""} ${row.error ?? ""}`.toLowerCase());
    if (row.error) entry.reason = blame(`error ${shape({ says: row.error })}`, NOT_CALLABLE, plain(row.error).trim(), entry, null, ["open"]);
    else {
      entry.cells = columns.map((column) => {
        const cell = row.cells?.[column.index];
        if (!cell) return null;
        const made = { cell, ...judge(cell, column.head), reason: null };
        const says = cell.stopped?.says ?? "";
        made.text = intern(`${column.name} ${made.word} ${says} ${cell.known ?? ""} ${made.failed ? "reference fails" : ""}`.toLowerCase());
        if (cell.stopped) made.reason = blame(shape(cell.stopped), cell.stopped.why, plain(says).trim(), entry, column, made.classes);
        return made;
      });
    }
    if (!modules.has(module)) modules.set(module, { name: module, rows: [], header: null, shown: 0 });
    modules.get(module).rows.push(entry);
    return entry;
  });
  const weight = (reason) => (FINDINGS.some((name) => reason.classes.has(name)) ? 0 : reason.classes.has("known") ? 1 : 2);
  return {
    matrix,
    columns,
    rows,
    modules: [...modules.values()],
    texts: [...texts.keys()],
    byName: new Map(rows.map((entry) => [entry.row.name, entry])),
    reasons: [...reasons.values()].sort((a, b) => weight(a) - weight(b) || b.rows.size - a.rows.size),
  };
}
