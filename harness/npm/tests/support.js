// @ts-check
// Makes projects that use the npm packages. `TESTED_KARAT` is the program, `TESTED_MODULES` is a `node_modules` with
// vitest, Playwright and TypeScript.

import fs from "node:fs";
import os from "node:os";
import path from "node:path";
import { after } from "node:test";

/** @param {string} name */
function must(name) {
  const value = process.env[name];
  if (!value) throw new Error(`${name} isn't set`);
  return path.resolve(value);
}

export const program = must("TESTED_KARAT");
const installed = must("TESTED_MODULES");
const sources = path.resolve(import.meta.dirname, "..");

const folders = /** @type {string[]} */ ([]);
after(() => folders.forEach((folder) => fs.rmSync(folder, { recursive: true, force: true })));

/** A folder that is deleted after the tests. */
export function scratch() {
  const folder = fs.realpathSync(fs.mkdtempSync(path.join(os.tmpdir(), "karat-npm-")));
  folders.push(folder);
  return folder;
}

/** A `node_modules` with the installed packages, and Karat's packages as `cargo ci dist` packs them. */
export const modules = path.join(scratch(), "node_modules");
fs.mkdirSync(modules);
for (const name of fs.readdirSync(installed).filter((name) => !/^(\.|karat-)/.test(name))) {
  fs.symlinkSync(path.join(installed, name), path.join(modules, name), "junction");
}
for (const name of ["vitest", "playwright"]) {
  const own = path.join(modules, `karat-${name}`);
  fs.cpSync(path.join(sources, name), own, { recursive: true });
  fs.copyFileSync(path.join(sources, "installed.js"), path.join(own, "installed.js"));
}

/**
 * @param {string} folder
 * @param {string} name
 * @param {string} text
 */
export function write(folder, name, text) {
  const file = path.join(folder, name);
  fs.mkdirSync(path.dirname(file), { recursive: true });
  fs.writeFileSync(file, text);
}

/**
 * Makes a project with these files.
 * @param {Record<string, string>} files
 */
export function project(files) {
  const folder = scratch();
  fs.symlinkSync(modules, path.join(folder, "node_modules"), "junction");
  const all = { "package.json": '{ "private": true, "type": "module" }', ...files };
  for (const [name, text] of Object.entries(all)) write(folder, name, text);
  return folder;
}

/**
 * Returns this environment without variables that choose paths or forbid goldens.
 * @param {Record<string, string>} more
 */
export function environment(more) {
  const own = Object.entries(process.env).filter(([name]) => !/^(KARAT_|TESTED_|CI$|GITHUB_)/.test(name));
  return { ...Object.fromEntries(own), NO_COLOR: "1", ...more };
}
