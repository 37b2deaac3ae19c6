// The values under the cursor, or of the pinned texel. They are exactly the values in the files.

(() => {
  const body = byId("inspector").querySelector("tbody");
  const cell = (text, className = "") => element("td", { className }, text);

  const row = (name, golden, actual, dark) => {
    const known = golden !== undefined && actual !== undefined;
    const delta = known ? actual - golden : null;
    const size = known ? Math.max(Math.abs(golden), dark) : 1;
    const ulps = known ? numbers.ulps(golden, actual) : null;
    const value = (number) => (number === undefined ? "–" : numbers.shortest(number));
    const same = known && (Object.is(golden, actual) || golden === actual);
    return element("tr", { className: same ? "same" : "" },
      element("th", { scope: "row" }, name),
      cell(value(golden)), cell(value(actual)),
      cell(numbers.rounded(delta, true)),
      cell(delta === null ? "–" : numbers.rounded(delta / size, true)),
      cell(ulps === null ? "–" : ulps < 1e6 ? String(ulps) : numbers.rounded(ulps)));
  };

  listeners.push(() => {
    const at = inspected();
    const { golden, actual } = part() ?? {};
    const g = texel(golden, at);
    const a = texel(actual, at);
    const channels = ["R", "G", "B", "A"];
    const dark = (channel) => (channel === 3 ? Number.MIN_VALUE : golden?.dark ?? Number.MIN_VALUE);
    body.replaceChildren(...channels.map((name, c) => row(name, g?.[c], a?.[c], dark(c))));
    const light = g ?? a;
    const stops = light ? Math.log2(tones.luminance(light) / 0.18) : NaN;
    const side = g ? "golden" : "actual";
    const level = Number.isFinite(stops) ? `, ${side} ${stops >= 0 ? "+" : "−"}${Math.abs(stops).toFixed(1)} stops` : "";
    byId("where").textContent = (g ?? a)
      ? `(${at[0]}, ${at[1]})${state.pinned ? " pinned" : ""}, tile (${at[0] >> 4}, ${at[1] >> 4})${level}`
      : "point at a pixel; click to pin it";
    const map = loaded()?.maps[state.map];
    const value = state.view === "map" && map ? texel(map.image, at) : null;
    byId("map-value").textContent = value
      ? `${map.name}: ${map.scalar ? (value[3] ? numbers.shortest(value[0]) : "none") : [...value].map(numbers.shortest).join(", ")}`
      : "";
  });
})();
