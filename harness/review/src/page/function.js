// A failing function, in place of images: its message and its plots, as in the report.

(() => {
  const pane = byId("function");

  // The server made this HTML, and has escaped all other text. Parsed in this way, the HTML runs no scripts.
  const figures = (markup) => [...new DOMParser().parseFromString(markup, "text/html").querySelectorAll("figure")]
    .map((figure) => document.importNode(figure, true));

  let shown = null;
  listeners.push(() => {
    const failure = selectedCase()?.status === "function" ? loaded() : null;
    pane.hidden = !failure || state.sheet;
    document.body.classList.toggle("no-images", selectedCase()?.status === "function");
    if (failure === shown || !failure) return;
    shown = failure;
    pane.replaceChildren(element("pre", {}, failure.message), ...figures(failure.figures));
    pane.scrollTop = 0;
  });
})();
