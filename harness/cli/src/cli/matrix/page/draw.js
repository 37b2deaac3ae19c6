// Drawing the page.

let sifted = null; // the settings for which the rows were drawn
function drawRows() {
  const shown = model.columns.filter(visible);
  byId("table").style.setProperty("--n", shown.length);
  const hidden = model.columns.filter((column) => !visible(column)).map(({ index }) => `#table tr.judged > :nth-child(${index + 2})`);
  columnSheet.replaceSync(hidden.length ? `${hidden.join(",")} { display: none }` : "");
  const { count, reason } = sift();
  byId("none").hidden = count > 0;
  byId("table").hidden = count === 0;
  byId("count").textContent = count === model.rows.length ? many(count, "row") : `${count.toLocaleString("en")} of ${many(model.rows.length, "row")}`;
  byId("chosen").textContent = `${shown.length} of ${model.columns.length}`;
  byId("because").hidden = !reason;
  if (reason) {
    byId("because-text").textContent = reason === "none" ? "No row has the reason in the link." : `Stopped by: ${reason.says.replace(/\s+/g, " ")}`;
    byId("because-text").title = reason === "none" ? "" : reason.says;
  }
  byId("reset").hidden = !(state.filter || state.show.size || state.kinds.size || state.columns || state.reason);
  byId("fold-all").disabled = model.modules.every(({ name }) => state.fold.has(name));
  byId("unfold-all").disabled = state.fold.size === 0;
  toggles.forEach((tell) => tell());
}

let marked = null;
function draw() {
  const next = models.find(({ matrix }) => matrix.package === state.package) ?? models[0];
  if (next !== model) {
    model = next;
    drawn = null;
    marked = null;
    buildHead();
    buildTable();
    buildTools();
    buildReasons();
    home();
  }
  // Moving the focus doesn't change the rows.
  const asked = JSON.stringify([state.package, state.filter, ...[state.show, state.kinds, state.columns ?? [null], state.fold].map((set) => [...set]), state.reason]);
  if (asked !== sifted) drawRows();
  sifted = asked;

  const entry = selected();
  const at = entry && { tr: entry.tr, button: targetIn(entry.tr, columnNamed(state.column)?.index ?? -1) };
  if (marked?.button !== at?.button) {
    marked?.tr.classList.remove("at");
    marked?.button?.classList.remove("at");
    at?.tr.classList.add("at");
    at?.button?.classList.add("at");
    marked = at;
  }
  drawPanel();
}
