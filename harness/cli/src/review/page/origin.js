// Where a case comes from: its test and how to run it again, the modules that changed since its golden,
// and the golden's versions.

const origin = (() => {
  // A button that copies, and says so where it was.
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
        // Without leave for the clipboard the text is selected, so that a person can copy it.
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
  const difference = ({ name, diff }) => element("details", {},
    element("summary", {}, name),
    element("pre", {}, ...diff.split("\n").map((text) => element("span", { className: MARKS[text[0]] ?? "" }, `${text}\n`))));

  const modules = (known) => {
    if (!known) return [];
    if (known.unknown) return [element("p", { className: "dim" }, `Which modules changed can't be told: ${known.unknown}.`)];
    const whose = known.all ? "of this repository " : "";
    if (!known.changed.length) return [element("p", { className: "dim" }, `No module ${whose}changed since the golden's commit ${known.since}.`)];
    const about = known.all ? " No record of a run says which of them the frame has." : "";
    return [element("p", { className: "dim" }, `Modules ${whose}that changed since the golden's commit ${known.since}.${about}`),
      ...known.changed.map(difference)];
  };

  const version = ({ commit, date, author, subject, because, by, at }) => element("li", {},
    element("span", { className: "dim" }, `${date} ${commit} ${author}`),
    element("div", {}, because || subject),
    ...(because ? [element("div", { className: "dim" }, [by && `accepted by ${by}`, at && `at ${at}`, `in “${subject}”`].filter(Boolean).join(" "))] : []));

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
    fill("versions", (data?.versions ?? []).map(version));
    const declared = (data?.declared ?? []).map(({ name, golden, actual }) => `${name}: ${golden || "none"} → ${actual || "none"}`);
    byId("declared").textContent = declared.join(", ");
  });

  return { copied };
})();
