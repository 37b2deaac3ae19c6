// A table of values in place of images. It shows the differing rows, the largest differences first, or all rows of a
// golden without pending values. If you choose an older version, it replaces the golden.

(() => {
  const pane = byId("table");

  const cell = (text, className) => element("td", { className }, text ?? "");

  // The results of both sides. Equal results are shown once.
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
    const data = selectedCase()?.table ? loaded() : null;
    const table = data?.older ?? data?.table;
    pane.hidden = !table;
    for (const id of ["tools", "inspector"]) byId(id).classList.toggle("unused", Boolean(selectedCase()?.table));
    if (table === shown || !table) return;
    shown = table;
    const names = table.columns.slice(table.arguments);
    const given = table.columns.slice(0, table.arguments).map((name) => head(name, "argument"));
    const old = table.commit ? `golden of ${table.commit}` : "golden";
    const sides = `${old}, then ${data.table.accepted ? "the golden now" : "actual"}`;
    const heads = table.accepted
      ? names.map((name) => head(name, "result"))
      : [...names.map((name) => head(name, sides, 2)),
        head("relative", "largest difference of a component, as a share of the golden")];
    pane.querySelector("thead tr").replaceChildren(head("row", "from 1"), ...given, ...heads);
    const made = table.accepted ? accepted : row;
    pane.querySelector("tbody").replaceChildren(...table.rows.map((entry) => made(entry, names.length)));
    const left = table.changed > table.rows.length;
    const more = left ? `; the ${table.accepted ? "first " : ""}${table.rows.length}${table.accepted ? "" : " that differ most"}` : "";
    const count = table.accepted ? `${table.changed} rows` : `${table.changed} ${table.changed === 1 ? "row differs" : "rows differ"}`;
    byId("table-count").textContent = `${count}${more}${table.commit ? `: ${sides}` : ""}`;
  });
})();
