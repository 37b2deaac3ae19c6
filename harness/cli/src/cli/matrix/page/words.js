// The texts of the page.

const STATUSES = ["translated", "valid", "executed", "agrees"];
// The kinds of cells, in the order of bars and toggles. `sign` is for readers who see no colours.
const SORTS = new Map(Object.entries({
  agrees: { sign: "✓", about: "it ran, and another column has the same results" },
  executed: { sign: "▷", about: "it ran on all inputs, and wrote all results" },
  valid: { sign: "◐", about: "all installed validators of the language accept it" },
  translated: { sign: "○", about: "naga writes it" },
  differs: { sign: "≠", word: "DIFFERS", about: "it ran, and its results differ from those of the compared column" },
  invalid: { sign: "✗", word: "INVALID", about: "a validator rejects what naga wrote" },
  panics: { sign: "!", word: "PANICS", about: "naga panics as it writes it" },
  broke: { sign: "?", word: "NO VERDICT", about: "a validator or a driver crashed, didn't end or doesn't run" },
  unsupported: { sign: "⊘", about: "naga doesn't write it. After another word: naga wrote it, but can't translate it further on this route" },
  known: { sign: "≡", word: "known", about: "the package declares that this fails, and it does; it isn't counted as a finding" },
}));
const FINDINGS = ["differs", "invalid", "panics", "broke", "unsupported", "reference"];
const WHY = new Map(Object.entries({
  unsupported: "naga can't translate it further",
  rejected: "A validator rejects it",
  panicked: "naga panics",
  broke: "A validator or driver has no verdict",
  no_validator: "No validator of the language is installed",
  unavailable: "Nothing on this machine runs it",
  not_run: "It isn't run",
  differs: "Its results differ",
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
