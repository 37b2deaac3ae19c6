/** Options of the plugin. All may be left out. */
export interface KaratOptions {
  /** Folders of shaders, relative to the root of the project. Default: those that `karat test` finds. */
  folders?: string[];
  /** Paths that tests run on, as `KARAT_PATHS` has them: `"vulkan,cpu"`. Default: what `karat test` runs on. */
  paths?: string;
  /** The program. Default: the npm package `karat`, or else `karat` in `PATH`. */
  program?: string;
}

/** Makes each `@test` of a `*_test.wgsl`, and each test of a `*.test.toml`, a test of vitest. */
export default function karat(options?: KaratOptions): import("vite").Plugin[];
