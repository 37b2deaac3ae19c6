// Accepting and rejecting: the page asks the server, or shows the command to type.

const decide = (() => {
  const accepting = byId("accept-dialog");
  const rejecting = byId("reject-dialog");
  const because = byId("because");
  let deciding = []; // the entries of the open dialog

  const command = (kind, entry) => (kind === "accept"
    ? `karat accept ${entry.name}${entry.accept} --because "…"`
    : `karat reject ${entry.name}${index.arguments}`);

  // Returns the data of a case that you have seen here, at least as a thumbnail: its pixels are known.
  const known = (entry) => entry.data ?? entry.thumb;

  const open = (kind) => {
    const entries = choose.entries();
    const [entry] = entries;
    if (!entry || ["unusable", "golden", "function"].includes(entry.status)) return;
    if (!index.served) {
      const line = byId(`${kind}-command`);
      line.focus();
      getSelection().selectAllChildren(line);
      return;
    }
    if (entries.length === 1 && !known(entry)) {
      announce(`${entry.name} is still being loaded: look at it first`);
      return;
    }
    if (entry.status !== "pending") {
      announce(`${entry.name} is ${entry.status === "gone" ? "no longer pending" : entry.status} already`);
      return;
    }
    deciding = entries;
    const dialog = kind === "accept" ? accepting : rejecting;
    const several = entries.length > 1;
    dialog.querySelector(".subject").textContent = several ? `${entries.length} frames` : entry.name;
    dialog.querySelector(".subjects").replaceChildren(...(several ? entries.map(({ name }) => element("li", {}, name)) : []));
    dialog.querySelector(".problem").textContent = "";
    because.value = "";
    if (kind === "accept") offer(entries);
    reasons.offer();
    dialog.showModal();
  };

  // The reason of the previous acceptance, because several frames often have the same reason. The page offers the
  // reason, but doesn't fill it in: pressing Enter at once must accept nothing.
  const reasons = (() => {
    const KEY = "karat.because";
    const button = byId("last-reason");
    let last = "";
    try {
      last = sessionStorage.getItem(KEY) ?? "";
    } catch {
      // Some viewers have no storage. Then the reason is kept until the page is closed.
    }
    button.addEventListener("click", () => {
      because.value = last;
      because.focus();
    });
    return {
      offer: () => {
        button.hidden = !last;
        button.querySelector("q").textContent = last;
      },
      take: () => { if (last) because.value = last; },
      keep: (text) => {
        last = text;
        try {
          sessionStorage.setItem(KEY, text);
        } catch {
          // This viewer may have no storage.
        }
      },
    };
  })();

  // The goldens that a frame may become. A frame from lavapipe applies to all machines. A frame that was compared with
  // its profile's golden replaces that golden.
  const foreign = ({ accepting: { canonical, own } }) => !canonical && !own;
  const replaces = (entry) => foreign(entry) && !entry.accepting.new;
  const offer = (entries) => {
    byId("of-own").hidden = !entries.some(({ accepting: { own } }) => own);
    byId("any-adapter-line").hidden = !entries.some((entry) => foreign(entry) && entry.accepting.new);
    byId("of-which").hidden = !entries.some(replaces);
    byId("any-adapter").checked = false;
    byId("of-profile").checked = true;
    const profiles = [...new Set(entries.map(({ accepting: { profile } }) => profile))].join(", ");
    document.querySelectorAll("#accept-form .profile").forEach((name) => { name.textContent = profiles; });
  };

  // Returns the selected golden in the form that the server expects.
  const chosen = (entry) => {
    const all = replaces(entry) && byId("of-all").checked;
    return { profile: replaces(entry) && !all, any_adapter: all || byId("any-adapter").checked };
  };

  const announce = (text) => {
    byId("news").textContent = text;
  };

  // Asks the server which frames are still pending: another page or a test may have decided.
  const refresh = (pending) => {
    if (!pending) return;
    for (const entry of state.cases) {
      if (entry.status === "pending" && !pending.includes(entry.name)) entry.status = "gone";
      if (entry.status === "gone" && pending.includes(entry.name)) entry.status = "pending";
    }
  };

  const next = () => {
    const left = listed().filter((position) => state.cases[position].status === "pending");
    const order = listed();
    const now = order.indexOf(state.selected);
    const following = left.find((position) => order.indexOf(position) > now) ?? left[0];
    if (following === undefined || selectedCase()?.status === "pending") change();
    else actions.select(following);
  };

  // Sends one decision. Returns the error, if there is one.
  const sendOne = async (kind, entry, details) => {
    const response = await fetch(kind, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ case: entry.name, pixels: entry.pixels, ...details }),
    });
    if (response.status !== 200 && response.status !== 409) throw new Error(await response.text());
    const answer = await response.json();
    if (!answer.error) entry.status = `${kind}ed`;
    refresh(answer.pending);
    return answer.error;
  };

  // A focused element in a dialog keeps the focus until the next frame is drawn, and would receive a key that is
  // pressed before.
  const shut = (dialog) => {
    dialog.close();
    if (dialog.contains(document.activeElement)) document.activeElement.blur();
  };

  // Sends all decisions, one after the other. Refused entries stay in the dialog; the others are done.
  const send = async (kind, dialog, details) => {
    const problem = dialog.querySelector(".problem");
    const buttons = dialog.querySelectorAll("button");
    const entries = deciding.filter(({ status }) => status === "pending" || deciding.length === 1);
    const several = entries.length > 1;
    problem.textContent = "";
    buttons.forEach((button) => { button.disabled = true; });
    const refused = [];
    let done = 0;
    try {
      for (const entry of entries) {
        const error = await sendOne(kind, entry, details(entry));
        if (error) refused.push(several && !error.includes(`\`${entry.name}\``) ? `${entry.name}: ${error}` : error);
        else done += 1;
      }
      if (done && kind === "accept") reasons.keep(because.value);
      if (refused.length) {
        problem.textContent = refused.join("\n");
      } else {
        shut(dialog);
        announce(several ? `${kind}ed ${done} frames` : `${entries[0].status} ${entries[0].name}`);
      }
    } catch (error) {
      problem.textContent = error instanceof TypeError
        ? "The server doesn't answer: is `karat review` still running?"
        : String(error.message);
    } finally {
      buttons.forEach((button) => { button.disabled = false; });
      const left = [...state.chosen].filter((position) => state.cases[position].status === "pending");
      change({ chosen: new Set(left) });
      if (!dialog.open) next();
    }
  };

  byId("accept-form").addEventListener("submit", (event) => {
    event.preventDefault();
    send("accept", accepting, (entry) => ({ because: because.value, ...chosen(entry) }));
  });
  byId("reject-form").addEventListener("submit", (event) => {
    event.preventDefault();
    send("reject", rejecting, () => ({}));
  });
  because.addEventListener("keydown", (event) => {
    if (event.key === "ArrowUp" && !because.value) {
      event.preventDefault();
      reasons.take();
    }
    if (event.key === "Enter" && !event.shiftKey && !event.isComposing) {
      event.preventDefault();
      byId("accept-form").requestSubmit();
    }
  });
  for (const button of document.querySelectorAll("dialog .close")) {
    button.addEventListener("click", () => shut(button.closest("dialog")));
  }
  for (const kind of ["accept", "reject"]) byId(kind).addEventListener("click", () => open(kind));

  listeners.push(() => {
    const entry = selectedCase();
    byId("decision").hidden = entry?.status === "golden" && !state.chosen.size;
    byId("served").hidden = !index.served;
    byId("typed").hidden = index.served || !entry || ["unusable", "golden", "function"].includes(entry.status);
    for (const kind of ["accept", "reject"]) {
      const one = !entry || !known(entry) || entry.status !== "pending";
      byId(kind).disabled = one && !state.chosen.size;
      if (entry && byId(`${kind}-command`).textContent !== command(kind, entry)) {
        byId(`${kind}-command`).textContent = command(kind, entry);
      }
    }
  });

  return { open };
})();
