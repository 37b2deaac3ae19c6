// @ts-check
// A matcher for Playwright. It compares a canvas with its golden by running `karat match`.

import { spawn } from "node:child_process";
import { mkdtemp, rm, writeFile } from "node:fs/promises";
import os from "node:os";
import path from "node:path";
import { expect as base, test } from "@playwright/test";

import { exr } from "./exr.js";
import { installed } from "./installed.js";

export { test };

/**
 * Arguments that give a Chromium without a GPU WebGPU on SwiftShader, and make it show the canvases that it draws. With
 * only the second argument, pages draw, but screenshots stay white.
 */
export const webgpu = [
  "--enable-unsafe-webgpu",
  "--use-webgpu-adapter=swiftshader",
  "--use-vulkan=swiftshader",
  "--use-angle=vulkan",
  "--enable-features=Vulkan",
];

/**
 * Returns the pixels of a canvas, as the bytes of a file and its extension.
 * @param {import("@playwright/test").Locator} canvas
 * @param {string | undefined} read
 * @returns {Promise<[string, Uint8Array]>}
 */
async function pixels(canvas, read) {
  // A screenshot is needed: after WebGPU has presented a canvas, reading the canvas gives black.
  if (!read) return ["png", await canvas.screenshot({ animations: "disabled", scale: "css" })];
  // The function is on the window of the canvas, which may be in a frame.
  const found = await canvas.evaluate(async (element, name) => {
    const own = /** @type {any} */ (element.ownerDocument.defaultView)[name];
    if (typeof own !== "function") throw new Error(`the page has no function \`${name}\``);
    const { width, height, data } = await own();
    if (![width, height].every((side) => Number.isInteger(side) && side > 0)) throw new Error(`\`${name}\` returned ${width} x ${height} pixels, which isn't a size`);
    const bytes = new Uint8Array(Float32Array.from(data).buffer);
    let text = "";
    // The text is made in pieces, because a call accepts only some ten thousand arguments.
    for (let at = 0; at < bytes.length; at += 0x8000) text += String.fromCharCode(...bytes.subarray(at, at + 0x8000));
    return { width, height, data: btoa(text) };
  }, read);
  const bytes = Buffer.from(found.data, "base64");
  const floats = new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength));
  if (floats.length !== 4 * found.width * found.height || floats.length === 0) {
    throw new Error(`\`${read}\` returned ${floats.length} floats for ${found.width} x ${found.height} pixels, but each pixel needs four floats`);
  }
  return ["exr", exr(found.width, found.height, floats)];
}

/**
 * @param {string} program
 * @param {string[]} words
 * @param {string} cwd
 * @returns {Promise<{ status: number | null, said: string }>}
 */
function run(program, words, cwd) {
  return new Promise((resolve, reject) => {
    const child = spawn(program, words, { cwd });
    let said = "";
    child.stdout.setEncoding("utf8").on("data", (text) => (said += text));
    child.stderr.setEncoding("utf8").on("data", (text) => (said += text));
    child.on("error", (error) => reject(new Error(
      `the program \`${program}\` doesn't run (${error.message}): install it with npm install --save-dev karat`,
    )));
    child.on("close", (status) => resolve({ status, said: said.trim() }));
  });
}

export const expect = base.extend({
  /**
   * @param {import("@playwright/test").Page | import("@playwright/test").Locator} received
   * @param {string} name
   * @param {import("./index.d.ts").MatchOptions} [options]
   */
  async toMatchKarat(received, name, options = {}) {
    if (typeof name !== "string" || !name || name.length > 100) throw new Error("the name of a golden must have 1 to 100 characters");
    const unknown = Object.keys(options).find((key) => !["goldens", "program", "read"].includes(key));
    if (unknown) throw new Error(`toMatchKarat has no option \`${unknown}\`: its options are goldens, program and read`);
    // A missing golden differs from everything, so a negated matcher would pass.
    if (this.isNot) throw new Error("`not.toMatchKarat` would also pass if the golden is missing: remove `not`, and accept another golden");
    const info = test.info();
    const root = info.config.configFile ? path.dirname(info.config.configFile) : info.config.rootDir;
    const canvas = "goto" in received ? received.locator("canvas") : received;
    const [ending, bytes] = await pixels(canvas, options.read);
    const folder = await mkdtemp(path.join(os.tmpdir(), "karat-playwright-"));
    try {
      const file = path.join(folder, `${name.replaceAll(/[^\w-]+/g, "-")}.${ending}`);
      await writeFile(file, bytes);
      const browser = canvas.page().context().browser();
      const by = browser ? `${browser.browserType().name()} ${browser.version()}` : "a browser";
      const program = options.program ?? installed(root) ?? "karat";
      const goldens = options.goldens ? [`--goldens=${path.resolve(root, options.goldens)}`] : [];
      const { status, said } = await run(program, ["match", "--by", by, ...goldens, "--", name, file], root);
      if (status !== 0) await info.attach(name, { body: Buffer.from(bytes), contentType: ending === "png" ? "image/png" : "image/x-exr" });
      return { pass: status === 0, name: "toMatchKarat", message: () => said.replace(/^error: /, "") || `karat ended with ${status}` };
    } finally {
      await rm(folder, { recursive: true, force: true });
    }
  },
});
