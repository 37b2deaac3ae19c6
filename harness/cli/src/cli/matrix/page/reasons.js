// The list of reasons.

const MANY_REASONS = 100;

function buildReasons() {
  const { reasons } = model;
  byId("reasons-count").textContent = many(reasons.length, "reason");
  const list = byId("reasons");
  list.replaceChildren();
  const put = (from) => {
    list.append(...reasons.slice(from, from + MANY_REASONS).map(reasonOf));
    if (reasons.length > from + MANY_REASONS) {
      const more = element("li", {}, button({ onclick: () => { more.remove(); put(from + MANY_REASONS); } }, `${reasons.length - from - MANY_REASONS} more`));
      list.append(more);
    }
  };
  // A folded list is drawn when it is opened.
  const about = byId("reasons-about");
  let done = false;
  about.ontoggle = () => {
    if (about.open && !done) {
      done = true;
      put(0);
    }
  };
  about.ontoggle();
}

function badge(sort, word = SORTS.get(sort).word ?? sort) {
  return element("span", { className: `badge k-${sort}` }, `${signOf(sort)} ${word}`);
}

function reasonOf(reason) {
  const sort = ["differs", "invalid", "panics", "broke", "unsupported", "known"].find((name) => reason.classes.has(name));
  const rows = [...reason.rows];
  const open = ([entry, column]) => link(plain(entry.row.name), () => change({ row: entry.row.name, column: column?.name ?? null }, { step: true }));
  const where = element("div", { className: "where" },
    `${many(reason.rows.size, "row")}${reason.columns.size ? `: ${[...reason.columns].map(([name, count]) => `${plain(name)} ${count}`).join(", ")}` : ""}. `,
    element("button", { type: "button", className: "link", onclick: () => {
      byId("filter").value = "";
      change({ reason: reason.id, filter: "", show: new Set(), kinds: new Set(), columns: null }, { step: true });
      byId("tools").scrollIntoView({ block: "start" });
    } }, "Show the rows"));
  const some = element("div", { className: "where" }, ...rows.slice(0, 6).map(open));
  if (rows.length > 6) {
    some.append(button({ className: "link", onclick: (event) => event.target.replaceWith(...rows.slice(6).map(open)) }, `${rows.length - 6} more`));
  }
  const others = reason.variants.size - 1;
  return element("li", {},
    sort ? badge(sort) : element("span", { className: "dim" }, reason.why === NOT_CALLABLE ? NOT_CALLABLE : WHY.get(reason.why) ?? "The row stops"),
    element("pre", {}, reason.says),
    others ? element("div", { className: "where" }, `${many(others, "more reason differs", "more reasons differ")} from this reason only in numbers, names or inputs.`) : null,
    where, some);
}
