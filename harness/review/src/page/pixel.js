// The origin of a pixel: the steps of the pinned pixel, and values of the shader as maps. The server runs the program
// for both. A page from files has only the steps of the pixels that differ most from the golden.

(() => {
  const pane = byId("pixel");
  const values = byId("told");
  const said = byId("pixel-state");
  const body = byId("steps");
  const known = (entry) => entry.data?.told ?? {};

  const ask = async (entry, question) => {
    const answer = await fetch(`ask/${entry.index}/${question}`, { headers: { Accept: "application/json" } });
    if (!answer.ok) throw new Error(await answer.text());
    const told = await answer.json();
    if (told.error) throw new Error(told.error);
    return told;
  };
  const size = () => extent().join("x");

  // The last question of each kind. The page ignores replies to earlier questions.
  const asked = { values: 0, tap: 0, trace: 0 };
  const attempt = async (kind, doing, work) => {
    asked[kind] += 1;
    const number = asked[kind];
    said.textContent = doing;
    try {
      const done = await work();
      if (number !== asked[kind]) return;
      said.textContent = "";
      done();
    } catch (error) {
      if (number === asked[kind]) said.textContent = error.message;
    }
  };

  const step = ({ file, line, operation, single, double, allowed, is_strange: strange, has_lost: lost }, parted) => element("tr",
    { className: parted ? "parted" : strange ? "strange" : lost ? "lost" : "", title: `f64: ${double}\nWGSL allows: ${allowed}` },
    element("td", {}, `${file.split("/").pop()}:${line}`), element("td", {}, operation), element("td", {}, single));

  // If git has the golden's commit, the page also asks for the steps with the shaders of that commit.
  const told = async (entry, [x, y]) => {
    if (!index.pixels) {
      const one = known(entry)[`${x},${y}`];
      if (!one) throw new Error(`without a server the page has only the steps of ${Object.keys(known(entry)).map((at) => `(${at.replace(",", ", ")})`).join(" and ")}`);
      return one;
    }
    const question = `trace/${size()}/${x},${y}`;
    const commit = entry.data?.versions?.[0]?.commit;
    try {
      if (commit) return [...(await ask(entry, `${question}/${commit}`)).pixel, commit];
    } catch {
      // Then the page shows only the steps of today's shaders: the golden's shaders may lack variables that the frame
      // binds.
    }
    return [null, (await ask(entry, question)).pixel, null];
  };

  const trace = (entry, at) => attempt("trace", `tracing (${at.join(", ")}) …`, async () => {
    const [before, pixel, commit] = await told(entry, at);
    return () => {
      const line = (text) => element("p", {}, text);
      const same = (a, b) => a && b && a.operation === b.operation && a.single === b.single;
      const differs = before ? pixel.steps.findIndex((own, i) => !same(before.steps[i], own)) : -1;
      const was = before?.steps[differs];
      const parting = !before ? []
        : differs < 0 ? [line(before.engine === pixel.engine ? `each step is the same as at the golden's commit ${commit}` : `a later run of a step differs from the golden's commit ${commit}`)]
          : [line(`the first step that differs from the golden's commit ${commit} was ${was ? `${was.operation}: ${was.single}` : "not there"}`)];
      body.replaceChildren(
        line(`${pixel.function} at (${at.join(", ")})`),
        ...pixel.arguments.map(([name, value]) => line(`${name} = ${value}`)),
        ...parting,
        element("table", {}, element("tbody", {}, ...pixel.steps.map((own, i) => step(own, i === differs)))),
        line(`the engine returns ${pixel.engine}`),
        line(`the driver drew ${pixel.driver}`),
        ...pixel.notes.map(line));
      body.querySelector(".parted")?.scrollIntoView({ block: "nearest" });
    };
  });

  const offer = (entry) => attempt("values", "asking for the values …", async () => {
    if (!index.pixels) {
      const option = (at) => element("option", { value: at }, `pixel (${at.replace(",", ", ")})`);
      return () => values.replaceChildren(element("option", { value: "" }, "pixels that differ most"), ...Object.keys(known(entry)).map(option));
    }
    const { values: lines } = await ask(entry, "values");
    return () => {
      const option = (line) => element("option", { value: line.split(": ")[0], title: line }, line.split(" = ")[0]);
      values.replaceChildren(element("option", { value: "" }, `one of ${lines.length}`), ...lines.map(option));
    };
  });

  values.addEventListener("change", () => {
    const entry = selectedCase();
    const value = values.value;
    if (!value || !entry?.data) return;
    if (!index.pixels) return change({ pinned: value.split(",").map(Number) });
    attempt("tap", `drawing ${value} …`, async () => {
      const { map } = await ask(entry, `tap/${size()}/${value}`);
      const image = await numbers.image(map.image);
      const scalar = image.values.every((number, i) => i % 4 === 0 || i % 4 === 3 || Object.is(number, image.values[i - (i % 4)]));
      return () => {
        const { maps } = entry.data;
        const known = maps.findIndex(({ name }) => name === map.name);
        maps.splice(known < 0 ? maps.length : known, 1, { ...map, image, scalar });
        change({ view: "map", map: known < 0 ? maps.length - 1 : known });
      };
    });
  });

  byId("trace").addEventListener("click", () => {
    const entry = selectedCase();
    if (entry && state.pinned) trace(entry, state.pinned);
  });

  let shown = null;
  let pinned = null;
  listeners.push(() => {
    const entry = selectedCase();
    const has = ["pending", "golden"].includes(entry?.status) && part() && (index.pixels || entry.data?.told);
    pane.hidden = !has;
    if (!has) return;
    if (shown !== entry) {
      shown = entry;
      values.replaceChildren(element("option", { value: "" }, "none"));
      body.replaceChildren();
      offer(entry);
    }
    byId("trace").disabled = !state.pinned;
    const at = state.pinned?.join() ?? null;
    // A click on a differing pixel requests its steps.
    const { golden, actual } = part();
    const [g, a] = [texel(golden, state.pinned), texel(actual, state.pinned)];
    const differs = g && a && g.some((value, c) => !Object.is(value, a[c]));
    if (at !== pinned && differs) trace(entry, state.pinned);
    pinned = at;
  });
})();
