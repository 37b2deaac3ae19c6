// @ts-check
// A plugin for vitest. It turns files with tests of shaders into modules that declare these tests, each at its own
// line.

import { readFileSync } from "node:fs";
import path from "node:path";
import { configDefaults } from "vitest/config";

import { Karat, isTest } from "./karat.js";

/** @typedef {import("./karat.js").Listed} Listed */

const TESTS = ["**/*_test.wgsl", "**/*_test.wesl", "**/*.test.toml"];

/** @param {string} file */
const isInput = (file) => /\.(wgsl|wesl|toml|csv|exr|png|json|obj)$/.test(file);

/**
 * Returns a module that declares the tests of a file. Each test is at its line in the file, so that vitest shows that
 * line.
 * @param {string} file
 * @param {Listed[]} listed
 * @param {string[]} errors
 * @param {string[]} packages Folders whose modules are validated here.
 */
function moduleOf(file, listed, errors, packages) {
  const lines = readFileSync(file, "utf8").split("\n").map(() => "");
  const runtime = JSON.stringify(import.meta.resolve("./runtime.js"));
  /** @type {Map<number, string[]>} */
  const byLine = new Map();
  for (const one of listed) {
    const call = one.error ? `broken(${JSON.stringify(one)})` : `declare(${JSON.stringify(one)})`;
    // `[[test]]` tables at the same line may have several assertions.
    byLine.set(one.line, [...(byLine.get(one.line) ?? []), " ".repeat(one.column - 1) + call]);
  }
  for (const [line, calls] of byLine) {
    while (lines.length < line) lines.push("");
    lines[line - 1] = calls.map((call, at) => (at ? call.trimStart() : call)).join("; ") + ";";
  }
  // Imports are hoisted, so they can be on the last line, which is free.
  lines.push(`import { broken, declare, failing, valid } from ${runtime};`);
  lines.push(...errors.map((error) => `failing(${JSON.stringify(error)});`));
  lines.push(...packages.map((folder) => `valid(${JSON.stringify(folder)});`));
  return lines.join("\n");
}

/**
 * @param {import("./index.d.ts").KaratOptions} [options]
 * @returns {import("vite").Plugin[]}
 */
export default function karat(options = {}) {
  // Without vitest, Vite builds or serves, and needs no tests.
  if (!process.env.VITEST) return [];
  const unknown = Object.keys(options).find((key) => !["folders", "paths", "program"].includes(key));
  if (unknown) throw new Error(`karat-vitest has no option \`${unknown}\`: its options are folders, paths and program`);
  /** @type {Karat | undefined} */
  let program;
  /** @type {Promise<string>} */
  let served = Promise.resolve("");
  /** @type {Set<string>} */
  const files = new Set();

  /** @param {string} file */
  const load = async (file) => {
    files.add(file);
    if (!program) return null;
    try {
      const all = await program.list();
      const own = all.filter((one) => one.file === file);
      const errors = own.length ? [] : [
        `no test of Karat is in ${path.relative(program.root, file)}: it has no \`@test\`, or each \`@test\` is under a false ` +
          "condition, or Karat doesn't search its folder: karat({ folders: [\"src/shaders\"] })",
      ];
      return moduleOf(file, own, errors, [...new Set(own.map((one) => one.package))]);
    } catch (error) {
      return moduleOf(file, [], [error instanceof Error ? error.message : String(error)], []);
    }
  };

  return [
    {
      name: "karat",
      enforce: "pre",
      async config(config) {
        const root = path.resolve(config.root ?? process.cwd());
        program ??= new Karat(root, options);
        served = program.serve();
        /** @type {{ include?: string[] } | undefined} */
        const given = /** @type {any} */ (config).test;
        const include = given?.include ? TESTS : [...configDefaults.include, ...TESTS];
        const own = program;
        return /** @type {any} */ ({
          test: {
            include,
            env: { VITEST_KARAT: await served },
            watchTriggerPatterns: [
              { pattern: /\.(wgsl|wesl|toml|csv|exr|png|json|obj)$/, testsToRun: (/** @type {string} */ file) => own.concerned(file, [...files]) },
            ],
          },
        });
      },
      configureServer(server) {
        server.watcher.on("all", (event, file) => {
          if (!isInput(file) || !program) return;
          program.forget(path.resolve(file));
          // If a file is deleted, vitest reruns no test unless the plugin asks for it.
          if (event !== "unlink") return;
          for (const test of program.concerned(file, [...files])) server.watcher.emit("change", test);
        });
      },
      load: (id) => (isTest(id) ? load(id) : null),
      closeBundle: () => program?.close(),
    },
    {
      // This plugin runs after plugins that treat each `*.wgsl` as text.
      name: "karat:last",
      enforce: "post",
      transform: async (_, id) => {
        const code = isTest(id) ? await load(id) : null;
        return code === null ? null : { code, map: null };
      },
    },
  ];
}
