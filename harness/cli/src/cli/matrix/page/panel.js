// The panel of a cell.

const quoted = (text) => (/^[\w:.,/-]+$/.test(text) ? text : `'${text.replace(/'/g, "'\\''")}'`);

// An entry point is named by its module and its own name.
function commandOf({ row }, language) {
  if (row.kind === "function" || !row.name.includes("::")) return `karat translate ${quoted(row.name)} --to ${quoted(language)}`;
  return `karat translate ${quoted(moduleOf(row.name))} --to ${quoted(language)} --entry-point ${quoted(lastOf(row.name))}`;
}

function section(title, ...children) {
  return element("section", {}, element("h3", {}, title), ...children);
}

// Returns the values of two results. Each component that differs is marked.
function apart(one, other) {
  const [left, right] = [plain(one).split(", "), plain(other).split(", ")];
  if (left.length !== right.length) return [plain(one), plain(other)].map((text) => element("td", {}, text));
  return [left, right].map((own, side) => {
    const td = element("td");
    own.forEach((value, i) => td.append(i ? ", " : "", left[i] === right[i] || own.length === 1 ? value : element("mark", {}, value)));
    td.dataset.side = side;
    return td;
  });
}

const pair = (name, value) => {
  const th = element("th", {}, name);
  th.scope = "row";
  return element("tr", {}, th, value instanceof Node ? value : element("td", {}, value));
};

function divergence(found, column, go) {
  const [here, there] = apart(found.here, found.there);
  const table = element("table", { className: "values" },
    element("tbody", {}, ...(found.arguments ?? []).map(([name, value]) => pair(plain(name), plain(value)))),
    element("tbody", {}, pair(`${plain(column.name)} returns`, here), pair(`${plain(found.baseline)} returns`, there)));
  const made = section(found.alone ? "The simplest input found for which the results differ" : "An input for which the results differ", table);
  const { first } = found;
  if (!found.alone) made.append(element("p", {}, "The two columns differ only if the kernel also runs other inputs: for this input alone, their results are equal."));
  else if (first) {
    const [a, b] = apart(first.here, first.there);
    made.append(element("p", {}, first.name === "return" ? "The first value that differs is what " : "The first value that differs is ",
      element("code", {}, first.name === "return" ? "return" : plain(first.name)), first.name === "return" ? " gives, in " : ", in ",
      link(`line ${first.line}`, () => go("author", first.line)),
      ...(first.text_line ? [" of the author, ", link(`line ${first.text_line}`, () => go("text", first.text_line)), " of the translation."] : [" of the author."])),
    element("table", { className: "values" }, element("tbody", {}, pair(plain(column.name), a), pair(plain(found.baseline), b))));
  } else made.append(element("p", { className: "dim" }, "All intermediate values that Karat could compare are equal."));
  if (found.unseen?.length) made.append(element("p", { className: "dim" }, `Karat couldn't compare ${found.unseen.map(plain).join(", ")}.`));
  return made;
}

// Returns the lines of the translation that the message of a validator names.
function accused(cell) {
  if (cell.stopped?.why !== "rejected") return [];
  const says = String(cell.stopped.says);
  return [...says.matchAll(/\b(?:ERROR|WARNING): (?:0|shader\.\w+):(\d+):|\bshader\.\w+:(\d+):/g)].map((m) => Number(m[1] ?? m[2]));
}

const AROUND = 3; // the number of lines above and below a marked line
const DIFFERENT = "The first value that differs";
const NAMED = "The reason names this line";
const WHOLE = 120; // shorter texts aren't folded if the function's lines are unknown

// Shows the lines of a text, numbered from `first`. The lines of `range` and those around marked lines are visible, the
// others appear with a click on a button. `marked` has the reason for each marked line.
function codeOf(text, { first = 1, range = null, marked = new Map(), label }) {
  const lines = plain(text).replace(/\n+$/, "").split("\n");
  const last = first + lines.length - 1;
  const marks = new Map([...marked].filter(([n]) => n >= first && n <= last));
  const [from, to] = range ?? (lines.length <= WHOLE || !marks.size ? [first, Math.min(last, first + 4 * WHOLE)] : [0, -1]);
  const made = element("div", { className: "code", tabIndex: 0 });
  made.setAttribute("role", "region");
  made.setAttribute("aria-label", label);
  const near = (n) => [...marks.keys()].some((mark) => Math.abs(mark - n) <= AROUND);
  const line = (n) => {
    const code = lines[n - first];
    const cut = code.indexOf("//");
    const l = element("div", { className: "l" });
    l.dataset.n = n;
    const held = element("span");
    held.append(cut < 0 ? code : code.slice(0, cut));
    if (cut >= 0) held.append(element("i", {}, code.slice(cut)));
    l.append(held);
    if (range && (n < range[0] || n > range[1])) l.classList.add("outside");
    if (marks.has(n)) {
      l.classList.add("marked");
      held.prepend(element("span", { className: "unseen" }, `${marks.get(n)}: `));
    }
    return l;
  };
  const lineRange = (a, b) => Array.from({ length: b - a + 1 }, (_, i) => line(a + i));
  let gap = null;
  const close = (end) => {
    if (gap === null) return;
    const start = gap;
    gap = null;
    const fold = button({ className: "fold" }, `⋯ ${many(end - start + 1, "line")}, ${start} to ${end}`);
    fold.onclick = () => {
      const opened = lineRange(start, end);
      fold.replaceWith(...opened);
    };
    fold.span = [start, end];
    made.append(fold);
  };
  for (let n = first; n <= last; n += 1) {
    if ((n >= from && n <= to) || near(n)) {
      close(n - 1);
      made.append(line(n));
    } else gap ??= n;
  }
  close(last);
  made.go = (n) => {
    [...made.querySelectorAll(".fold")].find(({ span: [a, b] }) => n >= a && n <= b)?.click();
    made.querySelector(`.l[data-n="${Number(n)}"]`)?.scrollIntoView({ block: "center" });
  };
  return made;
}

function side(title, about, ...children) {
  return element("div", { className: "code-side" }, element("h3", {}, title, " ", element("span", {}, about)), ...children);
}

function codesOf(entry, judged, column) {
  const { source } = entry.row;
  const cell = judged?.cell;
  const first = cell?.divergence?.first ?? null;
  const sides = {};
  const marked = new Map(first && source ? [[first.line, DIFFERENT]] : []);
  const named = /-->\s*([^\s:]+):(\d+)/.exec(cell?.stopped?.says ?? entry.row.error ?? "");
  if (named && source && named[1] === source.file) marked.set(Number(named[2]), NAMED);
  sides.author = source
    ? codeOf(source.text, { first: source.line, marked, range: [source.line, Infinity], label: "The author's lines" })
    : element("div", { className: "code" }, element("p", {}, "The page doesn't have the author's lines."));
  const author = side("Author", source ? `${plain(source.file)}:${source.line}` : plain(entry.row.location ?? ""), sides.author);
  if (!judged) return { codes: element("div", { className: "codes alone" }, author), sides };
  const text = Number.isInteger(cell.text) ? model.matrix.texts?.[cell.text] : undefined;
  if (typeof text === "string") {
    sides.text = codeOf(text, { range: cell.text_lines ?? null, marked: new Map([...accused(cell).map((n) => [n, NAMED]), ...(first?.text_line ? [[first.text_line, DIFFERENT]] : [])]), label: "The translation" });
  } else {
    const why = element("p");
    if (cell.status === null) why.append("naga can't translate the row, so the page has no translation.");
    else if (column.head.language === "spirv") {
      const command = `${commandOf(entry, "spirv")} | spirv-dis`;
      const copied = button({}, "Copy");
      copied.onclick = () => copy(command, copied);
      copied.setAttribute("aria-label", `Copy ${plain(command)}`);
      why.append("SPIR-V is binary. This command shows it as text: ", element("code", {}, plain(command)), " ", copied);
    } else why.append("The page doesn't have the translation.");
    sides.text = element("div", { className: "code" }, why);
  }
  const lines = cell.text_lines ? `lines ${cell.text_lines[0]} to ${cell.text_lines[1]}` : "";
  return { codes: element("div", { className: "codes" }, author, side(`${plain(column.head.language)} by naga`, lines, sides.text)), sides };
}

function factsOf(entry, judged, column, go) {
  const { cell } = judged;
  const facts = element("div", { className: "facts", tabIndex: 0 });
  facts.setAttribute("role", "region");
  facts.setAttribute("aria-label", "Details");
  if (cell.known) facts.append(section("Known", element("p", {}, plain(cell.known)), element("p", { className: "dim" }, "The package declares this failure, so the failure isn't counted as a finding.")));
  if (cell.divergence) facts.append(divergence(cell.divergence, column, go));
  if (cell.stopped) {
    const why = cell.status === null && cell.stopped.why === "unsupported" ? "naga can't translate the row" : WHY.get(cell.stopped.why) ?? "The row stops here";
    const said = section(why, element("pre", {}, plain(cell.stopped.says).trim()));
    const lines = [...new Set(accused(cell))].slice(0, 6);
    if (lines.length && Number.isInteger(cell.text)) said.append(element("p", {}, ...lines.flatMap((n, i) => [i ? ", " : "In the translation: ", link(`line ${n}`, () => go("text", n))])));
    facts.append(said);
  }
  if (cell.compared > 0) {
    const worst = Number.isFinite(cell.worst_ulp) ? ` The largest distance is ${many(cell.worst_ulp, "step", "steps")} of an f32 (ulp).` : "";
    facts.append(section("Results", element("p", {}, `${many(cell.compared, "case is", "cases are")} compared, and ${cell.differing ? `${cell.differing.toLocaleString("en")} of them ${cell.differing === 1 ? "differs" : "differ"} by more than the tolerance` : "none differs by more than the tolerance"}.${worst}`)));
  }
  if (cell.open > 0) facts.append(section("Left open", element("p", {}, `${many(cell.open, "result differs", "results differ")} where WGSL allows several results.`)));
  if (cell.allowed) {
    const { bounded, outside, first } = cell.allowed;
    const all = `WGSL bounds the results of ${many(bounded, "case", "cases")}.`;
    facts.append(section("What WGSL allows", element("p", {}, outside ? `✗ ${all} ${many(outside, "is", "are")} outside of the bounds: ${plain(first)}.` : `✓ ${all} All results are inside of the bounds.`)));
  }
  if (cell.reference) {
    const { passed, checks, worst } = cell.reference;
    const share = Number.isFinite(worst) ? ` The worst error is ${Number(worst.toPrecision(3))} times the tolerance.` : "";
    facts[passed ? "append" : "prepend"](section("Reference", element("p", {}, `${passed ? "✓" : "✗"} The package's own tests ${passed ? "accept" : "reject"} the row on this path: ${many(checks ?? 0, "check")}.${share}`)));
  }
  facts.append(section("naga's options", element("p", {}, plain(cell.options))));
  const tools = (cell.validators ?? []).map(({ command, version, verdict }) => {
    const copied = button({}, "Copy");
    copied.onclick = () => copy(command, copied);
    copied.setAttribute("aria-label", `Copy ${plain(command)}`);
    return element("div", { className: "tool" }, element("div", {}, element("code", {}, plain(command)), " ", copied),
      element("div", { className: "dim" }, plain(version)),
      verdict === "valid" ? element("div", {}, "✓ valid") : element("pre", {}, `✗ ${plain(verdict)}`));
  });
  facts.append(section("Validators", ...(tools.length ? tools : [element("p", {}, "No validator checked the translation.")])));
  if (column.head.adapter) facts.append(section("Runs on", element("p", {}, plain(column.head.adapter))));
  return facts;
}

function brief(says) {
  const [line] = plain(says).trim().split("\n");
  return line.length > 120 ? `${line.slice(0, line.lastIndexOf(" ", 120))} …` : line;
}

function rowFacts(entry) {
  const facts = element("div", { className: "facts" });
  const { row } = entry;
  if (row.error) facts.append(section("In no column", element("pre", {}, plain(row.error))));
  facts.append(section(plain(row.kind), element("p", {}, plain(row.location ?? ""))));
  if (entry.cells.length) {
    const body = element("tbody", {}, ...model.columns.filter(({ index }) => entry.cells[index]).map((column) => {
      const { word, sort, reason } = entry.cells[column.index];
      return element("tr", {}, element("td", {}, link(plain(column.name), () => change({ column: column.name }, { step: true }))),
        element("td", {}, badge(sort, word)), element("td", { className: "dim" }, reason ? brief(entry.cells[column.index].cell.stopped.says) : ""));
    }));
    facts.append(section("On each column", element("table", { className: "others" }, body)));
  }
  return facts;
}

let drawn = null; // the cell that the panel shows
const selected = () => (state.row === null ? null : model.byName.get(state.row) ?? null);
const columnNamed = (name) => model.columns.find((column) => column.name === name) ?? null;
const small = matchMedia("screen and (max-width: 760px)");

function drawPanel() {
  const panel = byId("panel");
  const entry = selected();
  const column = entry && !entry.row.error ? columnNamed(state.column) : null;
  panel.hidden = state.row === null;
  document.body.classList.toggle("opened", !panel.hidden);
  byId("scroller").inert = !panel.hidden && small.matches;
  const key = state.row === null ? null : JSON.stringify([state.package, state.row, column?.name ?? state.column]);
  if (key === drawn) return;
  drawn = key;
  const body = byId("panel-body");
  const status = byId("panel-status");
  if (state.row === null) return body.replaceChildren();
  const name = byId("panel-name");
  byId("panel-before").hidden = byId("panel-after").hidden = byId("copy-command").hidden = !column;
  status.replaceChildren();
  if (!entry || (state.column !== null && !column && !entry.row.error)) {
    name.textContent = entry ? plain(state.row) : "Not here";
    body.replaceChildren(element("div", { className: "facts" }, element("p", {}, entry
      ? `The link names column ${plain(state.column)}, which this matrix doesn't have.`
      : `The link names row ${plain(state.row)}, which this matrix doesn't have.`)));
    return undefined;
  }
  const judged = column ? entry.cells[column.index] : null;
  name.textContent = column ? `${plain(entry.row.name)} on ${plain(column.name)}` : plain(entry.row.name);
  if (judged) status.append(badge(judged.sort, judged.word + (judged.sort === "known" ? ", known" : "")));
  if (judged?.failed) status.append(" ", element("span", { className: "badge k-differs" }, "✗ reference fails"));
  const { codes, sides } = codesOf(entry, judged, column ?? { head: {} });
  const go = (which, n) => sides[which].go?.(n);
  body.replaceChildren(judged ? factsOf(entry, judged, column, go) : rowFacts(entry), codes);
  body.scrollTop = 0;
  // Only the pane of the code scrolls. The page doesn't move.
  for (const pane of codes.querySelectorAll(".code")) {
    const mark = pane.querySelector(".marked");
    if (mark && pane.scrollHeight > pane.clientHeight) pane.scrollTop = mark.offsetTop - pane.clientHeight / 2;
  }
  return undefined;
}
