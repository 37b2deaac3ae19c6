// The texts of the page.

const STATUSES = ["translated", "valid", "executed", "agrees"];
// The kinds of cells, in the order of bars and toggles. `sign` is for readers who see no colours.
const SORTS = new Map(Object.entries({
  agrees: { sign: "✓", about: "the row ran, and another column has the same results" },
  executed: { sign: "▷", about: "the row ran on all inputs, and wrote all results" },
  valid: { sign: "◐", about: "all installed validators of the language accept the translation" },
  translated: { sign: "○", about: "naga translated the row" },
  differs: { sign: "≠", word: "DIFFERS", about: "the row ran, and its results differ from the results of the compared column" },
  invalid: { sign: "✗", word: "INVALID", about: "a validator rejects naga's translation" },
  panics: { sign: "!", word: "PANICS", about: "naga panics during the translation" },
  broke: { sign: "?", word: "NO VERDICT", about: "a validator or a driver crashed, didn't end or doesn't run" },
  unsupported: { sign: "⊘", about: "naga can't translate the row. After another word: naga translated the row, but can't translate the result further on this route" },
  known: { sign: "≡", word: "known", about: "the package declares this failure, so the failure isn't counted as a finding" },
}));
const FINDINGS = ["differs", "invalid", "panics", "broke", "unsupported", "reference"];
const WHY = new Map(Object.entries({
  unsupported: "naga can't translate the row further",
  rejected: "A validator rejects the translation",
  panicked: "naga panics",
  broke: "A validator or driver has no verdict",
  no_validator: "No validator of the language is installed",
  unavailable: "Nothing on this machine runs this column",
  not_run: "The row isn't run",
  differs: "The results differ",
  nothing_to_compare: "No other column has results to compare",
}));

// Returns the word in the table of `karat matrix`.
function wordOf(cell) {
  const why = cell.stopped?.why;
  if (why === "differs") return "DIFFERS";
  if (why === "rejected") return "INVALID";
  if (why === "broke") return "NO VERDICT";
  if (why === "panicked") return "PANICS";
  return STATUSES.includes(cell.status) ? cell.status : "unsupported";
}

// The sort determines the colour and the sign. The toggles select by class. A cell is `idle` if nothing runs its column
// on this machine.
function judge(cell, head) {
  const word = wordOf(cell);
  const blocked = cell.stopped?.why === "unsupported" && word !== "unsupported";
  const failed = cell.reference?.passed === false;
  if (cell.known) return { word, blocked, failed, sort: "known", classes: ["known"] };
  const found = { DIFFERS: "differs", INVALID: "invalid", "NO VERDICT": "broke", PANICS: "panics", unsupported: "unsupported" }[word];
  const classes = [found ?? (blocked ? "unsupported" : word === "agrees" ? "agrees" : head.adapter ? "open" : "idle")];
  if (failed) classes.push("reference");
  return { word, blocked, failed, sort: found ?? word, classes };
}
const signOf = (sort) => SORTS.get(sort).sign;
const lastOf = (name) => name.slice(name.lastIndexOf("::") + (name.includes("::") ? 2 : 0));
const moduleOf = (name) => (name.includes("::") ? name.slice(0, name.lastIndexOf("::")) : "");
