import type { Locator, Page } from "@playwright/test";
export { test } from "@playwright/test";

/** Options of `toMatchKarat`, all optional. */
export interface MatchOptions {
  /** The folder of goldens, relative to the configuration's folder. Default: `golden`, as in `karat match`. */
  goldens?: string;
  /**
   * The name of a function of the page's `window` that returns `{ width, height, data }`: linear floats, four for each
   * pixel, from the upper left. Default: a screenshot of the canvas, with 8 bits a channel.
   */
  read?: string;
  /** The program. Default: the npm package `karat`, or else `karat` in `PATH`. */
  program?: string;
}

interface KaratMatchers<R> {
  /** Compares the canvas with the golden of this name, by Karat's metric. A page must have one canvas, or a locator must select one. */
  toMatchKarat(name: string, options?: MatchOptions): R;
}

declare global {
  namespace PlaywrightTest {
    interface Matchers<R, T> extends KaratMatchers<R> {}
  }
}

/** Playwright's `expect`, with `toMatchKarat`. */
export const expect: typeof import("@playwright/test").expect & (<T extends Page | Locator>(actual: T) => KaratMatchers<Promise<void>>);

/** `launchOptions.args` that give a Chromium without a GPU WebGPU, and make it show its canvases. */
export const webgpu: string[];
