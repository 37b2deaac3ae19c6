// A table of values in place of images: the rows that differ, those that differ most first, or all rows
// of a golden that nothing is pending for.

(() => {
  const pane = byId("table");

  const cell = (text, className) => element("td", { className }, text ?? "");

  // A result of both sides; where they are the same, it is shown once.
  const results = (golden, actual, count) => [...Array(count).keys()].flatMap((at) => {
    const [before, after] = [golden[at], actual[at]];
    if (before === after) return [cell(before, ""), cell("=", "same")];
    return [cell(before ?? "none", "golden"), cell(after ?? "gone", "actual")];
  });

  const row = ({ row: number, arguments: given, golden, actual, relative }, count) => {
    const error = relative === null ? "" : numbers.rounded(relative);
    return element("tr", {},
      cell(String(number), "number"),
      ...given.map((text) => cell(text, "argument")),
      ...results(golden, actual, count),
      cell(error, "error"));
  };

  const accepted = ({ row: number, arguments: given, golden }) => element("tr", {},
    cell(String(number), "number"),
    ...given.map((text) => cell(text, "argument")),
    ...golden.map((text) => cell(text, "")));

  const head = (text, title, columns = 1) => element("th", { scope: "col", title, colSpan: columns }, text);

  let shown = null;
  listeners.push(() => {
    const table = selectedCase()?.table ? loaded()?.table : null;
    pane.hidden = !table;
    for (const id of ["tools", "inspector"]) byId(id).classList.toggle("unused", Boolean(selectedCase()?.table));
    if (table === shown || !table) return;
    shown = table;
    const names = table.columns.slice(table.arguments);
    const given = table.columns.slice(0, table.arguments).map((name) => head(name, "argument"));
    const heads = table.accepted
      ? names.map((name) => head(name, "result"))
      : [...names.map((name) => head(name, "golden, then actual", 2)),
        head("relative", "largest difference of a component, as a share of the golden")];
    pane.querySelector("thead tr").replaceChildren(head("row", "from 1"), ...given, ...heads);
    const made = table.accepted ? accepted : row;
    pane.querySelector("tbody").replaceChildren(...table.rows.map((entry) => made(entry, names.length)));
    const left = table.changed > table.rows.length;
    const more = left ? `; the ${table.accepted ? "first " : ""}${table.rows.length}${table.accepted ? "" : " that differ most"}` : "";
    byId("table-count").textContent = `${table.changed} rows${table.accepted ? "" : " differ"}${more}`;
  });
})();
