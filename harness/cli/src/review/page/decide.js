// Accepting and rejecting: by asking the server, or by showing what to type.

const decide = (() => {
  const accepting = byId("accept-dialog");
  const rejecting = byId("reject-dialog");
  const because = byId("because");

  const command = (kind, entry) => (kind === "accept"
    ? `karat accept ${entry.name}${entry.accept} --because "…"`
    : `karat reject ${entry.name}${index.arguments}`);

  const open = (kind) => {
    const entry = selectedCase();
    if (!entry || entry.status === "unusable") return;
    if (!index.served) {
      const line = byId(`${kind}-command`);
      line.focus();
      getSelection().selectAllChildren(line);
      return;
    }
    if (!entry.data) return;
    if (entry.status !== "pending") {
      announce(`${entry.name} is ${entry.status === "gone" ? "no longer pending" : entry.status} already`);
      return;
    }
    const dialog = kind === "accept" ? accepting : rejecting;
    dialog.querySelector(".subject").textContent = entry.name;
    dialog.querySelector(".problem").textContent = "";
    because.value = "";
    if (kind === "accept") offer(entry.data.accepting);
    dialog.showModal();
  };

  // What the frame may become the golden of. One from lavapipe is everybody's, and one that was
  // compared with its profile's golden replaces that.
  const offer = ({ canonical, own, profile, new: first }) => {
    byId("of-own").hidden = !own;
    byId("any-adapter-line").hidden = canonical || own || !first;
    byId("of-which").hidden = canonical || own || first;
    byId("any-adapter").checked = false;
    byId("of-profile").checked = true;
    document.querySelectorAll("#accept-form .profile").forEach((name) => { name.textContent = profile; });
  };

  // The same, as it is sent.
  const chosen = () => {
    const which = !byId("of-which").hidden;
    const all = which && byId("of-all").checked;
    return { profile: which && !all, any_adapter: all || byId("any-adapter").checked };
  };

  const announce = (text) => {
    byId("news").textContent = text;
  };

  // What is pending now, as the server says: another page or a test may have decided.
  const refresh = (pending) => {
    if (!pending) return;
    for (const entry of state.cases) {
      if (entry.status === "pending" && !pending.includes(entry.name)) entry.status = "gone";
      if (entry.status === "gone" && pending.includes(entry.name)) entry.status = "pending";
    }
  };

  const next = () => {
    const left = listed().filter((position) => state.cases[position].status === "pending");
    const following = left.find((position) => position > state.selected) ?? left[0];
    if (following === undefined) change();
    else actions.select(following);
  };

  const send = async (kind, dialog, details) => {
    const entry = selectedCase();
    const problem = dialog.querySelector(".problem");
    const buttons = dialog.querySelectorAll("button");
    problem.textContent = "";
    buttons.forEach((button) => { button.disabled = true; });
    try {
      const response = await fetch(kind, {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ case: entry.name, pixels: entry.data.pixels, ...details }),
      });
      if (response.status !== 200 && response.status !== 409) throw new Error(await response.text());
      const answer = await response.json();
      if (!answer.error) entry.status = `${kind}ed`;
      refresh(answer.pending);
      if (answer.error) {
        problem.textContent = answer.error;
        change();
      } else {
        dialog.close();
        announce(`${entry.status} ${entry.name}`);
        next();
      }
    } catch (error) {
      problem.textContent = error instanceof TypeError
        ? "The server doesn't answer: is `karat review` still running?"
        : String(error.message);
    } finally {
      buttons.forEach((button) => { button.disabled = false; });
    }
  };

  byId("accept-form").addEventListener("submit", (event) => {
    event.preventDefault();
    send("accept", accepting, { because: because.value, ...chosen() });
  });
  byId("reject-form").addEventListener("submit", (event) => {
    event.preventDefault();
    send("reject", rejecting, {});
  });
  because.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && !event.shiftKey && !event.isComposing) {
      event.preventDefault();
      byId("accept-form").requestSubmit();
    }
  });
  for (const button of document.querySelectorAll("dialog .close")) {
    button.addEventListener("click", () => button.closest("dialog").close());
  }
  for (const kind of ["accept", "reject"]) byId(kind).addEventListener("click", () => open(kind));

  listeners.push(() => {
    const entry = selectedCase();
    byId("served").hidden = !index.served;
    byId("typed").hidden = index.served || !entry || entry.status === "unusable";
    for (const kind of ["accept", "reject"]) {
      byId(kind).disabled = !entry?.data || entry.status !== "pending";
      if (entry && byId(`${kind}-command`).textContent !== command(kind, entry)) {
        byId(`${kind}-command`).textContent = command(kind, entry);
      }
    }
  });

  return { open };
})();
