// The frames that you chose, to decide about them together.

const choose = (() => {
  const canBe = (position) => index.served && state.cases[position]?.status === "pending";
  const set = (positions) => change({ chosen: new Set(positions.filter(canBe)) });

  const toggle = (position) => {
    if (!canBe(position)) return;
    const chosen = new Set(state.chosen);
    if (!chosen.delete(position)) chosen.add(position);
    set([...chosen]);
  };
  // Chooses all listed frames. If all are chosen, chooses none.
  const all = () => {
    const every = listed().filter(canBe);
    set(every.every((position) => state.chosen.has(position)) ? [] : every);
  };
  const none = () => set([]);

  // The checkbox of a frame in the list.
  const box = (position) => {
    const several = state.cases.filter(({ index: number }) => number !== null).length > 1;
    if (!index.served || !several || !("accepting" in state.cases[position])) return [];
    const input = element("input", { type: "checkbox", checked: state.chosen.has(position), disabled: !canBe(position) });
    input.setAttribute("aria-label", `Choose ${state.cases[position].name}`);
    input.title = "Decide several together (y)";
    input.addEventListener("click", () => {
      toggle(position);
      input.blur();
    });
    return [element("label", { className: "choose" }, input)];
  };

  // The entries to decide about: the chosen ones that are still pending, or otherwise the entry on the stage.
  const entries = () => {
    const chosen = [...state.chosen].filter(canBe).map((position) => state.cases[position]);
    return chosen.length ? chosen : [selectedCase()].filter(Boolean);
  };

  byId("choose-none").addEventListener("click", none);
  listeners.push(() => {
    const count = [...state.chosen].filter(canBe).length;
    byId("choosing").hidden = !count;
    byId("chosen").textContent = `${count} chosen`;
    byId("accept-label").textContent = count ? `Accept ${count}` : "Accept";
    byId("reject-label").textContent = count ? `Reject ${count}` : "Reject";
  });

  return { toggle, all, none, box, entries };
})();
