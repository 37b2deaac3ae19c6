import type { Locator, Page } from "@playwright/test";
export { test } from "@playwright/test";

/** Options of `toMatchKarat`. All may be left out. */
export interface MatchOptions {
  /** Folder of goldens, relative to the configuration's folder. Default: that of `karat match`, `golden`. */
  goldens?: string;
  /**
   * The name of a function of the page's `window`, which returns `{ width, height, data }`: linear floats, four for each pixel,
   * from the upper left. Default: a screenshot of the canvas, with 8 bits a channel.
   */
  read?: string;
  /** The program. Default: the npm package `karat`, or else `karat` in `PATH`. */
  program?: string;
}

interface KaratMatchers<R> {
  /** Compares the canvas with the golden of a name by Karat's metric. A page must have one canvas; or name one by a locator. */
  toMatchKarat(name: string, options?: MatchOptions): R;
}

declare global {
  namespace PlaywrightTest {
    interface Matchers<R, T> extends KaratMatchers<R> {}
  }
}

/** Playwright's `expect`, with `toMatchKarat`. */
export const expect: typeof import("@playwright/test").expect & (<T extends Page | Locator>(actual: T) => KaratMatchers<Promise<void>>);

/** `launchOptions.args` by which a Chromium without a GPU has WebGPU, and shows what it draws. */
export const webgpu: string[];
