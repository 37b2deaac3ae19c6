// @ts-check
// The place where npm puts the program. Each package that runs the program includes this file.

import { createRequire } from "node:module";
import path from "node:path";

/**
 * The program that npm installed.
 * @param {string} root
 */
export function installed(root) {
  const own = `karat-${process.platform}-${process.arch}`;
  const file = process.platform === "win32" ? "karat.exe" : "karat";
  // It is a dependency of the package `karat`, and a package manager may put it in a place that only that package sees.
  for (const from of [path.join(root, "package.json"), import.meta.url]) {
    try {
      const main = createRequire(from).resolve("karat/package.json");
      return createRequire(main).resolve(`${own}/bin/${file}`);
    } catch {}
  }
  return undefined;
}
