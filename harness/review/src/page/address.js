// The frame in the address: `index.html#rooms/dark` shows this frame, so that you can send a link to it.

const address = (() => {
  const WAIT = 400; // ms; Safari refuses more than 100 changes in 30 s, and a key that is held repeats faster
  const fragment = (name) => `#${encodeURIComponent(name).replaceAll("%2F", "/")}`;

  const named = () => {
    const text = location.hash.slice(1);
    try {
      return decodeURIComponent(text);
    } catch {
      return text; // typed by hand: its % isn't an escape
    }
  };

  let known = location.hash; // the fragment that the page has followed or written

  // Shows the named frame. If it doesn't exist, the page shows no other frame instead.
  const follow = () => {
    known = location.hash;
    const name = named();
    if (!name) return;
    const position = state.cases.findIndex((entry) => entry.name === name);
    if (!listed().includes(position)) change({ filter: "" });
    actions.select(position);
    if (position < 0) change({ absent: name });
  };
  window.addEventListener("hashchange", follow);

  let shown = state.selected;
  let timer = null;
  listeners.push(() => {
    if (state.selected === shown) return;
    shown = state.selected;
    clearTimeout(timer);
    timer = setTimeout(() => {
      // If the fragment isn't the known one, you have just typed it. The event for it follows, and takes precedence.
      if (location.hash !== known || !selectedCase() || named() === selectedCase().name) return;
      try {
        history.replaceState(null, "", fragment(selectedCase().name));
        known = location.hash;
      } catch {
        // Some viewers of artefacts forbid this. Then only the link is lost.
      }
    }, WAIT);
  });

  return { follow };
})();
