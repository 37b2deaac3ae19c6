"use strict";
// The page of `karat matrix --html`. Rows are functions and entry points, columns are routes.
//
// The page inserts data as text, never as HTML, because a shader's author may be anyone. The address contains the state
// of the page, so that a link shows the same view to others.

// Making elements.

const byId = (id) => document.getElementById(id);

// Makes an element: `element("td", { className: "number" }, "1.5")`.
function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}
const button = (properties, ...children) => element("button", { type: "button", ...properties }, ...children);
const link = (text, onclick) => button({ className: "link", onclick }, text);

// Invisible characters, and characters that reverse the order of others, are shown as their numbers: text must look as
// a compiler reads it.
const HIDDEN = /[\u0000-\u0008\u000b-\u001f\u007f-\u009f\u00ad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u2069\ufeff]/g;
const plain = (text) =>
  String(text ?? "").replace(/\r\n/g, "\n").replace(HIDDEN, (c) => `\\u{${c.codePointAt(0).toString(16)}}`);

const many = (count, one, more = `${one}s`) => `${count.toLocaleString("en")} ${count === 1 ? one : more}`;

function announce(told, text, restore) {
  told.textContent = text;
  setTimeout(() => told.replaceChildren(...restore), 1500);
}

async function copy(text, told) {
  const restore = [...told.childNodes];
  try {
    await navigator.clipboard.writeText(text);
    announce(told, "Copied", restore);
  } catch {
    // Some browsers don't allow this for pages from files.
    const area = element("textarea", { value: text });
    document.body.append(area);
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    announce(told, done ? "Copied" : "The browser doesn't allow it", restore);
  }
}
