// Older versions of a golden, from its commits. They load when you see them: as thumbnails in the golden's history, or
// for a table as the number of differing rows. The chosen version is shown beside the current one. For an image, it is
// an additional part.

const versions = (() => {
  const body = byId("versions").querySelector(".body");
  const known = new Map(); // by entry and commit: { thumb, table, error, loading, wanted }
  const of = (entry, commit) => {
    const key = `${entry.index} ${commit}`;
    if (!known.has(key)) known.set(key, { thumb: null, table: null, error: null, loading: false, wanted: false });
    return known.get(key);
  };

  const load = (entry, commit) => {
    const version = of(entry, commit);
    if (version.loading) return;
    version.loading = true;
    const script = element("script", { src: `data/${entry.index}-${commit}.js`, async: true });
    script.addEventListener("error", () => {
      const why = index.served ? "can't be loaded" : "left out to keep this report small";
      Object.assign(version, { loading: false, error: why });
      fill();
    });
    script.addEventListener("load", () => script.remove());
    document.head.append(script);
  };

  // Receives the data of a data file.
  const received = async (entry, { version: commit, image: stored, table, why }) => {
    const version = of(entry, commit);
    Object.assign(version, { loading: false, error: why, table });
    if (table && version.wanted) chooseTable(entry, commit, table);
    if (stored) {
      const image = prepared(await numbers.image(stored));
      delete image.words;
      version.thumb ??= thumbs.light(image);
      if (version.wanted) compareWith(entry, commit, image);
    }
    version.wanted = false;
    fill();
  };

  const isOlder = ({ version }) => Boolean(version);
  const without = (entry) => {
    stage.forget?.(entry.data.parts.filter(isOlder).map(({ golden }) => golden));
    entry.data.parts = entry.data.parts.filter((made) => !isOlder(made));
  };

  const compareWith = (entry, commit, image) => {
    if (entry !== selectedCase() || !entry.data) return;
    without(entry);
    const [judged] = entry.data.parts;
    const [old, now] = [`golden of ${commit}`, judged.actual ? "Actual" : "Golden now"];
    entry.data.parts.push({
      name: old,
      version: commit,
      golden: image,
      actual: judged.actual ?? judged.golden,
      names: { golden: `Golden of ${commit}`, actual: now, difference: `${now} − ${old}` },
    });
    change({ part: entry.data.parts.length - 1, sheet: false });
  };

  // Returns the rows of a table that differ since a commit, in place of the rows that the entry shows.
  const chooseTable = (entry, commit, table) => {
    if (entry !== selectedCase() || !entry.data) return;
    entry.data.older = commit && { ...table, commit };
    change();
  };

  const chosen = (entry) => (entry?.table ? entry.data?.older?.commit : part()?.version);

  const choose = (entry, commit) => {
    if (entry.table) {
      const { table } = of(entry, commit);
      if (chosen(entry) === commit) chooseTable(entry, null);
      else if (table) chooseTable(entry, commit, table);
      else of(entry, commit).wanted = true;
      return;
    }
    if (part()?.version === commit) {
      without(entry);
      change({ part: 0 });
      return;
    }
    of(entry, commit).wanted = true;
    load(entry, commit);
  };

  // A thumbnail loads only when you scroll to it.
  const waiting = new WeakMap(); // the function that loads the thumbnail of a button
  const seen = new IntersectionObserver((items) => {
    for (const { isIntersecting, target } of items) {
      if (!isIntersecting) continue;
      seen.unobserve(target);
      waiting.get(target)();
    }
  });

  const picture = (entry, { commit, pixels }) => {
    if (pixels && pixels === entry.data.golden_pixels) return [element("span", { className: "now" }, "as now")];
    // If only the provenance changed, a later version already has this image.
    const first = entry.data.versions.find((other) => pixels && other.pixels === pixels);
    if (first && first.commit !== commit) return [element("span", { className: "now" }, `as ${first.commit}`)];
    const { thumb, table, error } = of(entry, commit);
    if (error) return [element("span", { className: "now" }, error)];
    const rows = table ? `${table.changed} ${table.changed === 1 ? "row differs" : "rows differ"}` : "…";
    const button = element("button", { type: "button", className: "version", title: "Compare with this version; again: with the golden" },
      entry.table ? rows : thumbs.copy(thumb, "thumb"));
    button.setAttribute("aria-label", `Compare with the golden of ${commit}`);
    button.setAttribute("aria-pressed", String(chosen(entry) === commit));
    button.dataset.commit = commit;
    button.addEventListener("click", (event) => {
      choose(entry, commit);
      if (event.detail) button.blur();
    });
    if (!thumb && !table) {
      waiting.set(button, () => load(entry, commit));
      seen.observe(button);
    }
    return [button];
  };

  const row = (entry, version) => {
    const { commit, date, author, subject, because, by, at } = version;
    return element("li", {}, ...picture(entry, version), element("div", {},
      element("span", { className: "dim" }, `${date} ${commit} ${author}`),
      element("div", {}, because || subject),
      ...(because ? [element("div", { className: "dim" }, [by && `accepted by ${by}`, at && `at ${at}`, `in “${subject}”`].filter(Boolean).join(" "))] : [])));
  };

  const fill = () => {
    const [entry, all] = [selectedCase(), loaded()?.versions ?? []];
    byId("versions").hidden = !all.length;
    seen.disconnect();
    const focused = body.contains(document.activeElement) ? document.activeElement.dataset.commit : null;
    body.replaceChildren(...all.map((version) => row(entry, version)));
    if (focused) body.querySelector(`[data-commit="${focused}"]`)?.focus();
  };

  let shown = null;
  listeners.push(() => {
    const now = [selectedCase(), loaded(), chosen(selectedCase())];
    if (shown && now.every((value, at) => value === shown[at])) return;
    shown = now;
    fill();
  });

  return { received };
})();
