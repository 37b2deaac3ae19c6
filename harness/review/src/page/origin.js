// The origin of a case: its test, the commands to run it again, and the modules that changed since its golden.

const origin = (() => {
  // A button that copies a text, and shows a confirmation in place of its label.
  const copied = (text, label) => {
    const button = element("button", { type: "button", className: "copy", title: text }, label);
    const say = (word) => {
      button.textContent = word;
      setTimeout(() => { button.textContent = label; }, 1500);
    };
    button.addEventListener("click", async (event) => {
      if (event.detail) button.blur();
      try {
        await navigator.clipboard.writeText(text);
        say("Copied");
      } catch {
        // If the clipboard isn't accessible, the text is selected, so that you can copy it.
        const shown = button.parentElement.querySelector("code");
        if (shown) getSelection().selectAllChildren(shown);
        say("Selected");
      }
    });
    return button;
  };

  const line = (name, text) => element("div", { className: "line" },
    element("span", { className: "label" }, name), element("code", {}, text), copied(text, "Copy"));

  const NTH = ["", "2nd ", "3rd "];
  const test = ({ name, place, replays }) => [
    line("test", name),
    ...(place ? [line("at", place)] : []),
    ...replays.map((command, at) => line(`${NTH[at] ?? `${at + 1}th `}replay`, command)),
  ];

  const MARKS = { "+": "added", "-": "removed", "@": "place" };
  const note = (text) => element("span", { className: "dim" }, `: ${text}`);
  const difference = ({ name, diff, note: said }) => {
    const about = said ? [note(said)] : [];
    if (!diff) return element("p", { className: "module" }, name, ...about);
    return element("details", {},
      element("summary", {}, name, ...about),
      element("pre", {}, ...diff.split("\n").map((text) => element("span", { className: MARKS[text[0]] ?? "" }, `${text}\n`))));
  };

  const modules = (known) => {
    const said = (text) => element("p", { className: "dim" }, text);
    if (!known) return [];
    if (known.unknown) return [said(`The changed modules are unknown: ${known.unknown}.`)];
    if (known.hashed) {
      const why = known.otherwise ? " The linked program changed, because features, overrides or Karat changed." : "";
      if (!known.changed.length) return [said(`The hashes show that no module changed since the golden.${why}`)];
      return [said("The hashes show that these modules changed since the golden:"), ...known.changed.map(difference)];
    }
    const whose = known.all ? "of this repository " : "";
    if (!known.changed.length) return [said(`No module ${whose}changed since the golden's commit ${known.since}.`)];
    const about = known.all ? " Without the record of a run, Karat doesn't know which of these modules the frame uses." : "";
    return [said(`Modules ${whose}that changed since the golden's commit ${known.since}.${about}`),
      ...known.changed.map(difference)];
  };

  let shown = null;
  listeners.push(() => {
    const entry = selectedCase();
    const data = loaded();
    if (shown && shown[0] === entry && shown[1] === data) return;
    shown = [entry, data];
    const fill = (id, children) => {
      byId(id).hidden = !children.length;
      byId(id).querySelector(".body").replaceChildren(...children);
    };
    const known = data?.test ?? entry?.test;
    fill("test", known ? test(known) : []);
    fill("modules", modules(data?.modules));
    const declared = (data?.declared ?? []).map(({ name, golden, actual }) => `${name}: ${golden || "none"} → ${actual || "none"}`);
    byId("declared").textContent = declared.join(", ");
  });

  return { copied };
})();
