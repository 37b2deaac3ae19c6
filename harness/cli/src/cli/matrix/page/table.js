// The table.

const columnSheet = new CSSStyleSheet();
document.adoptedStyleSheets = [columnSheet];

const proto = (() => {
  const td = element("td");
  td.setAttribute("role", "cell");
  const made = button({ className: "cell", tabIndex: -1 }, element("span", { className: "sign" }, "·"), "");
  made.firstChild.setAttribute("aria-hidden", "true");
  td.append(made);
  return td;
})();

function cellOf(entry, column) {
  const td = proto.cloneNode(true);
  const made = td.firstChild;
  const judged = entry.cells[column.index];
  if (!judged) {
    td.replaceChildren();
    return td;
  }
  const { word, sort, blocked, failed, cell } = judged;
  made.classList.add(`k-${sort}`);
  if (failed && sort !== "known") made.classList.add("failed");
  made.firstChild.textContent = signOf(sort);
  made.append(word);
  const more = [];
  if (sort === "known") more.push("known");
  if (blocked) more.push(signOf("unsupported"));
  if (failed) more.push("✗ref");
  else if (cell.reference?.passed) more.push("✓ref");
  if (more.length) made.append(element("span", { className: "more" }, more.join(" ")));
  const aloud = [word, sort === "known" && "known", blocked && "then unsupported", failed && "its reference test fails", cell.reference?.passed && "its reference test passes"];
  made.setAttribute("aria-label", `${aloud.filter(Boolean).join(", ")}: ${plain(lastOf(entry.row.name))} on ${plain(column.name)}`);
  return td;
}

function bar(counts, total) {
  const made = element("div", { className: "bar" });
  made.setAttribute("aria-hidden", "true");
  for (const [sort, { word = sort }] of SORTS) {
    const count = counts.get(sort) ?? 0;
    if (!count) continue;
    const part = element("span", { className: `k-${sort}`, title: `${count} ${word}` }, count / total > 0.06 ? String(count) : "");
    part.style.flexGrow = count;
    made.append(part);
  }
  return made;
}

// Returns a bar with the number of rows that reach each status in a column.
function countsOf({ index }) {
  const counts = { sorts: new Map(), classes: new Map(), reached: [0, 0, 0, 0], known: 0, total: 0 };
  for (const { cells } of model.rows) {
    const judged = cells[index];
    if (!judged) continue;
    counts.total += 1;
    counts.sorts.set(judged.sort, (counts.sorts.get(judged.sort) ?? 0) + 1);
    judged.classes.forEach((name) => counts.classes.set(name, (counts.classes.get(name) ?? 0) + 1));
    const reached = STATUSES.indexOf(judged.cell.status);
    for (let i = 0; i <= reached; i += 1) counts.reached[i] += 1;
  }
  return counts;
}

const headed = (text, properties = {}) => {
  const th = element("th", properties, text);
  th.scope = "col";
  return th;
};

function buildTable() {
  const table = byId("table");
  const caption = table.caption;
  table.replaceChildren(caption);
  table.setAttribute("role", "table");
  const group = (tag, ...trs) => {
    const made = element(tag, {}, ...trs);
    made.setAttribute("role", "rowgroup");
    return made;
  };
  const line = (className, ...cells) => {
    const made = element("tr", { className }, ...cells);
    made.setAttribute("role", "row");
    return made;
  };
  const head = line("judged", headed(element("b", {}, "Row"), { role: "columnheader" }));
  for (const column of model.columns) {
    const { head: about, counts, name } = column;
    const th = headed(element("b", {}, plain(name)), { title: `${plain(name)}: ${plain(about.language)}, ${about.adapter ? `on ${plain(about.adapter)}` : plain(about.unavailable ?? "nothing on this machine runs it")}` });
    th.append(element("small", {}, plain(about.language) + (about.adapter ? "" : ", not run")), bar(counts.sorts, Infinity));
    head.append(th);
  }
  head.childNodes.forEach((th) => th.setAttribute("role", "columnheader"));
  table.append(group("thead", head));
  for (const module of model.modules) {
    const sign = element("span", {}, "▾");
    sign.setAttribute("aria-hidden", "true");
    const count = element("span", { className: "dim" });
    const fold = button({ tabIndex: -1 }, sign, ` ${plain(module.name || model.matrix.package)}`, count);
    const th = element("th", {}, fold);
    th.scope = "rowgroup";
    th.setAttribute("role", "rowheader");
    th.setAttribute("aria-colspan", String(model.columns.length + 1));
    const tr = line("module", th);
    tr.module = module;
    module.header = { tr, button: fold, sign, count };
    const trs = module.rows.map((entry) => {
      const { row } = entry;
      const name = button({ className: "name", tabIndex: -1, title: plain(row.name) }, plain(lastOf(row.name)));
      if (entry.kind !== "function") name.append(element("small", {}, plain(entry.kind)));
      const own = element("th", {}, name);
      own.scope = "row";
      own.setAttribute("role", "rowheader");
      entry.tr = line(row.error ? "row" : "row judged", own);
      entry.tr.entry = entry;
      if (row.error) {
        const out = element("td", { className: "out", title: plain(row.error) }, `in no column: ${plain(row.error)}`);
        out.setAttribute("role", "cell");
        out.setAttribute("aria-colspan", String(model.columns.length));
        entry.tr.append(out);
      } else entry.tr.append(...model.columns.map((column) => cellOf(entry, column)));
      return entry.tr;
    });
    table.append(group("tbody", tr, ...trs));
  }
}
