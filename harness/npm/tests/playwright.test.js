// @ts-check
// Uses `karat-playwright` as a project does. `TESTED_CHROMIUM` is the path of a browser.

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";
import { test } from "node:test";

import { environment, modules, program, project } from "./support.js";

const browser = process.env.TESTED_CHROMIUM ?? "chromium";

const CONFIG = `import { defineConfig } from "@playwright/test";
import { webgpu } from "karat-playwright";
const args = ["--no-sandbox", ...webgpu];
export default defineConfig({ reporter: "line", use: { launchOptions: { executablePath: ${JSON.stringify(browser)}, args } } });
`;

// The page is on loopback, because WebGPU needs a secure context.
const SPEC = `import http from "node:http";
import { expect, test } from "karat-playwright";

const options = { program: ${JSON.stringify(program)} };

const drawn = (colour) => \`<canvas width=16 height=8></canvas><script type=module>
  const device = await (await navigator.gpu.requestAdapter()).requestDevice();
  const context = document.querySelector("canvas").getContext("webgpu");
  context.configure({ device, format: "rgba8unorm", usage: GPUTextureUsage.COPY_DST | GPUTextureUsage.RENDER_ATTACHMENT });
  // The left half has the colour, and the right half is black.
  const data = new Uint8Array(16 * 8 * 4).map((_, at) => at % 4 === 3 ? 255 : at % 64 < 32 ? \${colour}[at % 4] : 0);
  device.queue.writeTexture({ texture: context.getCurrentTexture() }, data, { bytesPerRow: 64 }, [16, 8]);
  window.floats = () => ({ width: 2, height: 1, data: [0.25, 1, 2, 1, -1, 1e-3, 70000, 1] });
  window.short = () => ({ width: 2, height: 2, data: [0.25] });
  window.ready = true;
</script>\`;

test.beforeEach(async ({ page }) => {
  const server = http.createServer((_, answer) => {
    answer.setHeader("Content-Type", "text/html");
    answer.end(drawn(process.env.COLOUR));
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", () => resolve()));
  await page.goto(\`http://127.0.0.1:\${server.address().port}/\`);
  await page.waitForFunction("window.ready");
  server.close();
});

test("canvas", async ({ page }) => await expect(page).toMatchKarat("canvas", options));
test("floats", async ({ page }) => await expect(page.locator("canvas")).toMatchKarat("floats", { ...options, read: "floats" }));
if (process.env.WRONG) {
  test("short", async ({ page }) => await expect(page).toMatchKarat("short", { ...options, read: "short" }));
  test("none", async ({ page }) => await expect(page).toMatchKarat("none", { ...options, read: "none" }));
  test("negated", async ({ page }) => await expect(page).not.toMatchKarat("canvas", options));
  test("blank", async ({ page }) => {
    await page.setContent("<canvas width=16 height=8></canvas>");
    await expect(page).toMatchKarat("blank", options);
  });
  test("missing", async ({ page }) => await expect(page).toMatchKarat("canvas", { program: "no-karat" }));
}
`;

test("canvases are compared with goldens, and wait for a review", () => {
  const folder = project({ "playwright.config.js": CONFIG, "canvas.spec.js": SPEC });
  /** @param {Record<string, string>} env */
  const run = (env) => {
    const all = [path.join(modules, "@playwright/test/cli.js"), "test"];
    const ran = spawnSync(process.execPath, all, { cwd: folder, encoding: "utf8", env: environment(env), timeout: 180_000 });
    assert.equal(ran.signal, null, "it hangs");
    return { code: ran.status, text: ran.stdout + ran.stderr };
  };
  /** @param {string[]} words */
  const karat = (...words) => spawnSync(program, words, { cwd: folder, encoding: "utf8", env: environment({}) });
  const COLOUR = "[128, 64, 255]";
  const first = run({ COLOUR });
  assert.equal(first.code, 1);
  for (const name of ["canvas", "floats"]) {
    assert.match(first.text, new RegExp(`frame \`${name}\` has no golden`));
    const accepted = karat("accept", name, "--any-adapter", "--goldens", "golden", "--because", "it is the first");
    assert.equal(accepted.status, 0, accepted.stderr);
  }
  const second = run({ COLOUR });
  assert.equal(second.code, 0, second.text);
  const wrong = run({ COLOUR: "[128, 255, 64]", WRONG: "1" });
  assert.equal(wrong.code, 1);
  assert.match(wrong.text, /frame `canvas` differs from its golden/);
  assert.match(karat("pending", "--goldens", "golden").stdout, /canvas +differs/);
  // Each of these fails, because there is nothing to compare.
  assert.match(wrong.text, /all pixels of the image .* have the same colour/);
  assert.match(wrong.text, /`short` returned 1 floats for 2 x 2 pixels, but each pixel needs four floats/);
  assert.match(wrong.text, /the page has no function `none`/);
  assert.match(wrong.text, /accept another golden/);
  assert.match(wrong.text, /`no-karat` doesn't run.*npm install --save-dev karat/);
  assert.match(wrong.text, /6 failed/);
  assert.ok(!fs.existsSync(path.join(folder, "golden/short.new.exr")));
});
