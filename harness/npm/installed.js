// @ts-check
// Finds the program that npm installed. Each package that runs the program includes this file.

import { createRequire } from "node:module";
import path from "node:path";

/**
 * Returns the path of the program that npm installed.
 * @param {string} root
 */
export function installed(root) {
  const own = `karat-${process.platform}-${process.arch}`;
  const file = process.platform === "win32" ? "karat.exe" : "karat";
  // The program is a dependency of the package `karat`. A package manager may install it where only the package `karat`
  // finds it.
  for (const from of [path.join(root, "package.json"), import.meta.url]) {
    try {
      const main = createRequire(from).resolve("karat/package.json");
      return createRequire(main).resolve(`${own}/bin/${file}`);
    } catch {}
  }
  return undefined;
}
