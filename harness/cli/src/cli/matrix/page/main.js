// The start of the page.

(async () => {
  try {
    models = (await read()).map(modelOf);
    byId("scroller").hidden = false;
    listen();
    if (innerWidth <= 760 || innerHeight <= 560) byId("columns-about").open = false;
    follow();
  } catch (error) {
    byId("scroller").hidden = true;
    const trouble = byId("trouble");
    trouble.hidden = false;
    trouble.textContent = error instanceof Trouble ? error.message : `The page can't show its data: ${error?.message ?? error}`;
  }
})();
