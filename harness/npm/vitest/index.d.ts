/** Options of the plugin, all optional. */
export interface KaratOptions {
  /** Folders of shaders, relative to the project's root. Default: those that `karat test` finds. */
  folders?: string[];
  /** The paths that tests run on, in the format of `KARAT_PATHS`: `"vulkan,cpu"`. Default: those of `karat test`. */
  paths?: string;
  /** The program. Default: the npm package `karat`, or else `karat` in `PATH`. */
  program?: string;
}

/** Turns each `@test` of a `*_test.wgsl`, and each test of a `*.test.toml`, into a test of vitest. */
export default function karat(options?: KaratOptions): import("vite").Plugin[];
