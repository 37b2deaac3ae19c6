// @ts-check
// The JavaScript of the packages has the declared types, and the TypeScript of users compiles with them.

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import path from "node:path";
import { test } from "node:test";

import { modules, project, write } from "./support.js";

const OPTIONS = {
  allowJs: true, checkJs: true, maxNodeModuleJsDepth: 0, module: "nodenext", noEmit: true, skipLibCheck: true, strict: true,
  target: "es2022", types: ["node"],
};

/**
 * @param {string} folder
 * @param {string[]} files
 */
function check(folder, files) {
  write(folder, "tsconfig.json", JSON.stringify({ compilerOptions: OPTIONS, files }));
  const ran = spawnSync(process.execPath, [path.join(modules, "typescript/lib/tsc.js"), "-p", folder], { encoding: "utf8" });
  return { code: ran.status, text: ran.stdout + ran.stderr };
}

test("the packages have the types that they say", () => {
  for (const [name, files] of [
    ["vitest", ["index.js", "index.d.ts", "karat.js", "runtime.js", "installed.js"]],
    ["playwright", ["index.js", "index.d.ts", "exr.js", "installed.js"]],
  ]) {
    const { code, text } = check(path.join(modules, `karat-${name}`), /** @type {string[]} */ (files));
    assert.equal(code, 0, text);
  }
});

test("users' TypeScript takes them", () => {
  const folder = project({
    "vitest.config.ts": `import { defineConfig } from "vitest/config";
import karat from "karat-vitest";
export default defineConfig({ plugins: [karat({ folders: ["src"], paths: "cpu" })] });
`,
    "canvas.spec.ts": `import { expect, test } from "karat-playwright";
test("canvas", async ({ page }) => {
  await expect(page).toMatchKarat("canvas", { read: "floats" });
  await expect(page.locator("canvas")).toBeVisible();
});
`,
  });
  const { code, text } = check(folder, ["vitest.config.ts", "canvas.spec.ts"]);
  assert.equal(code, 0, text);
  write(folder, "slip.ts", 'import karat from "karat-vitest";\nkarat({ path: "cpu" });\n');
  assert.match(check(folder, ["slip.ts"]).text, /'path' does not exist/);
});
