// The facts about both sides: the verdict with its explanation, the gates with their margins, and the metadata.

(() => {
  const NAMES = {
    "adapter.path": "path", "adapter.name": "adapter", "adapter.driver": "driver",
    "adapter.software": "software", exposures: "FLIP exposures", color_space: "colour space", because: "accepted because",
    accepted_by: "accepted by", accepted_at: "accepted at",
  };
  // Facts that explain a difference come first. Facts that aren't in this list follow in their own order.
  const ORDER = ["shader", "adapter.path", "adapter.name", "adapter.driver", "processor", "because",
    "accepted_by", "accepted_at", "tolerance", "precision", "width", "height"];
  // Hashes of pixels repeat the difference, and don't explain it.
  const HIDDEN = ["pixels", "schema", "table.arguments", "table.types"];
  const rank = ({ name, differs }) => (differs ? -100 : 0) + (ORDER.indexOf(name) + 1 || 50);
  // The beginning identifies a hash. The title has the whole hash.
  const short = (text) => (/^[0-9a-f]{40,}$/.test(text) ? text.slice(0, 12) : text);

  // Returns text in which numbers don't break after their sign: 1e-3.
  const whole = (text) => text.split(/(\S*\de-\d\S*)/).map((piece, i) =>
    (i % 2 ? element("span", { className: "number" }, piece) : piece));

  const gate = ({ name, ratio, value, bound, note, place, passes }) => {
    const number = typeof value === "number"; // otherwise a string: NaN, inf
    const times = number && bound ? `, ${numbers.rounded(value / bound)} × bound` : "";
    const measured = element("div", {},
      element("span", { className: "name" }, name),
      element("span", { className: "values" },
        ratio ? "" : `${number ? numbers.rounded(value) : value} of ${numbers.rounded(bound)}`));
    const judged = element("div", {},
      element("span", { className: "margin" }, passes ? `passes${times}` : `fails${times}`));
    const row = element("li", { className: passes ? "passes" : "fails" }, measured, judged);
    if (note) row.append(element("span", { className: "note" }, note));
    if (place) {
      const [left, top, right, bottom] = place;
      const [width, height] = [right - left + 1, bottom - top + 1];
      const text = `(${left}, ${top})${width * height > 1 ? `, ${width} × ${height}` : ""}`;
      const button = element("button", { type: "button", className: "place", title: "look at it (w)" }, `${bound ? "worst" : "first"} at ${text}`);
      button.addEventListener("click", () => lookAt(place));
      judged.append(button);
    }
    return row;
  };

  // `alone` is set if there is no golden to compare with.
  const fact = ({ name, golden, actual, differs }, alone) => {
    const value = (text) => element("td", { title: text }, short(text) || "–");
    const wide = (text) => Object.assign(value(text), { colSpan: 2, className: "shared" });
    // Only a golden has the facts of its acceptance, so the table needs one column for them, too.
    const accepted = name.startsWith("accepted_") || ["because", "exposures"].includes(name);
    const values = alone ? [wide(actual)]
      : golden === actual || accepted ? [wide(golden)] : [value(golden), value(actual)];
    return element("tr", { className: differs ? "differs" : "" },
      element("th", { scope: "row" }, NAMES[name] ?? name.replace(/^facts\./, "").replaceAll("_", " ")), ...values);
  };

  let shown = null;
  listeners.push(() => {
    const data = loaded();
    // While a case loads, the page keeps the space for it.
    const none = !selectedCase() || Boolean(selectedCase().error) || selectedCase().status === "function";
    for (const id of ["judged", "facts"]) byId(id).hidden = none;
    if (data === shown) return;
    shown = data;
    byId("verdict").replaceChildren(...whole(data?.verdict ?? ""));
    byId("cause").textContent = data?.cause ?? "";
    byId("cause").title = data?.cause ?? "";
    byId("cause").classList.toggle("accepted", selectedCase()?.status === "golden");
    byId("gates").replaceChildren(...(data?.gates ?? []).map(gate));
    byId("no-gates").hidden = !data || Boolean(data.table) || selectedCase().status !== "pending" || data.gates.length > 0;
    const hidden = data?.table ? [...HIDDEN, "precision", "width", "height"] : HIDDEN;
    const facts = (data?.facts ?? []).filter(({ name }) => !hidden.includes(name));
    facts.sort((a, b) => rank(a) - rank(b));
    const alone = facts.every(({ golden }) => !golden);
    byId("facts").querySelector("thead").hidden = alone;
    const rows = facts.map((entry) => fact(entry, alone));
    byId("facts").querySelector("tbody").replaceChildren(...rows);
  });
})();
