// The summary above the table.

function buildHead() {
  const { matrix, columns, rows } = model;
  byId("title").replaceChildren("Translations of ", element("code", {}, plain(matrix.package)));
  byId("title").lastChild.style.font = "inherit";
  document.title = `Translations of ${plain(matrix.package)} by naga ${plain(matrix.naga)}`;
  const outside = rows.filter(({ row }) => row.error).length;
  byId("about").textContent = [
    `naga ${plain(matrix.naga)} translates ${many(rows.length - outside, "row")} for ${many(columns.length, "column")}.`,
    matrix.cases ? `Karat calls each function that can run with ${many(matrix.cases, "input")}.` : "",
    outside ? `${many(outside, "row is", "rows are")} in no column.` : "",
  ].filter(Boolean).join(" ");

  const tabs = byId("packages");
  tabs.hidden = models.length < 2;
  tabs.replaceChildren(...models.map((one) => {
    const tab = button({ onclick: () => change({ ...fresh(), package: one.matrix.package }, { step: true }) }, plain(one.matrix.package));
    tab.setAttribute("aria-pressed", String(one === model));
    return tab;
  }));

  columns.forEach((column) => { column.counts = countsOf(column); });
  const summary = byId("summary");
  const number = (value) => element("td", { className: "number" }, String(value));
  const body = element("tbody", {}, ...columns.map((column) => {
    const { head, counts, name } = column;
    const th = element("th", {}, element("b", {}, plain(name)));
    th.scope = "row";
    const runs = plain(head.adapter ?? head.unavailable ?? "nothing on this machine runs it");
    const findings = element("td", { className: "findings" }, ...FINDINGS.filter((sort) => counts.classes.has(sort)).map((sort) => {
      const told = `${counts.classes.get(sort)} ${SHOWS.get(sort).label}`;
      return link(told, () => {
        change({ show: new Set([sort]), filter: "", kinds: new Set(), columns: new Set([name]), reason: null }, { step: true });
        byId("filter").value = "";
        byId("tools").scrollIntoView({ block: "start" });
      });
    }));
    if (!findings.childNodes.length) findings.append(element("span", { className: "dim" }, "none"));
    if (counts.classes.has("known")) findings.append(element("span", { className: "dim" }, `  ${counts.classes.get("known")} known`));
    return element("tr", {}, th,
      element("td", {}, plain(head.language)),
      element("td", { className: "runs" }, element("span", { title: runs }, head.adapter ? runs : `not run: ${runs}`)),
      ...counts.reached.map(number),
      element("td", { className: "far" }, bar(counts.sorts, counts.total)),
      findings);
  }));
  summary.replaceChildren(summary.caption, element("thead", {}, element("tr", {},
    headed("column"), headed("language"), headed("runs on"),
    ...STATUSES.map((status) => headed(status, { className: "number" })), headed("progress of rows"), headed("findings"))), body);

  const tools = Object.entries(matrix.validators ?? {});
  byId("validators").replaceChildren(...tools.map(([tool, version]) =>
    element("div", {}, element("dt", {}, plain(tool)), element("dd", {}, plain(version)))));
  if (!tools.length) byId("validators").append(element("div", {}, element("dd", {}, "No validator is installed.")));
}
