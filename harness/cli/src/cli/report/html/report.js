"use strict";
const search = document.getElementById("search");
const failing = document.getElementById("failing");
const rows = [...document.querySelectorAll(".row")];

// Rows that contain all words stay. Sections without such rows are hidden.
function filter() {
  const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  let count = 0;
  for (const row of rows) {
    const text = `${row.textContent} ${row.dataset.words || ""}`.toLowerCase();
    const stays = words.every(word => text.includes(word))
      && (!failing.checked || row.classList.contains("failing"));
    row.hidden = !stays;
    count += stays ? 1 : 0;
  }
  for (const section of document.querySelectorAll("section")) {
    section.hidden = !section.querySelector(".row:not([hidden])") && (words.length > 0 || failing.checked);
  }
  document.getElementById("none").hidden = count > 0 || rows.length === 0;
}
search.addEventListener("input", filter);
failing.addEventListener("change", filter);

for (const button of document.querySelectorAll("button[data-copy]")) {
  button.addEventListener("click", async () => {
    const command = button.dataset.copy;
    try {
      await navigator.clipboard.writeText(command);
      button.textContent = "Copied";
    } catch {
      // Pages from files may not write to the clipboard.
      button.replaceWith(Object.assign(document.createElement("code"), { textContent: command }));
    }
  });
}
