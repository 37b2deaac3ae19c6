// The contact sheet: golden, frame and difference of every listed case, in place of the stage.

(() => {
  const pane = byId("sheet");

  const card = (position) => {
    const entry = state.cases[position];
    const { thumb } = entry;
    const times = entry.severity;
    const verdict = entry.status === "golden" ? `accepted golden${entry.table ? ", a table" : ""}` : entry.status !== "pending" ? entry.status : entry.new ? "new"
      : times === Infinity ? "can't be compared" : times ? `${numbers.rounded(times)} × its tolerance` : "";
    const odd = [entry.odd?.nan && "NaN", entry.odd?.size && "another size"].filter(Boolean);
    const button = element("button", { type: "button", className: "card" },
      element("span", { className: "pictures" },
        ...["golden", "actual", "difference"].map((side) => thumbs.copy(thumb?.[side], "thumb"))),
      element("span", { className: "name" }, entry.name),
      element("span", { className: "about" }, [verdict, ...odd].filter(Boolean).join(", ")));
    button.setAttribute("aria-current", String(position === state.selected));
    button.addEventListener("click", () => {
      actions.select(position);
      change({ sheet: false });
    });
    return button;
  };

  let shown = "";
  listeners.push(() => {
    pane.hidden = !state.sheet;
    byId("sheet-open").setAttribute("aria-pressed", String(state.sheet));
    if (!state.sheet) { shown = ""; return; }
    const positions = listed().filter((position) => state.cases[position].status !== "function");
    const now = JSON.stringify([positions, state.selected, state.cases.map(({ status, thumb }) => [status, Boolean(thumb)])]);
    if (now === shown) return;
    shown = now;
    pane.replaceChildren(
      element("p", {}, "golden | actual | difference"),
      element("div", { className: "cards" }, ...positions.map(card)));
    pane.querySelector("[aria-current=true]")?.scrollIntoView({ block: "nearest" });
  });
})();
