// @ts-check
// Uses `karat-vitest` as a project does.

import assert from "node:assert/strict";
import { spawn, spawnSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";
import { test } from "node:test";

import { environment, modules, program, project, scratch, write } from "./support.js";

const vitest = path.join(modules, "vitest/vitest.mjs");

const SHADER = `fn reinhard(luminance: f32) -> f32 {
    return luminance / (1.0 + luminance);
}

fn wide(x: vec3f) -> vec3f {
    return x * 2.0;
}
`;

const GOOD = `import package::tone::reinhard;
import karat::expect_near;

@test
fn half_at_one() {
    expect_near(reinhard(1.0), 0.5, 1e-6);
}
`;

const DECLARED = `[[test]]
function = "reinhard"
over = { luminance = "0..10" }
in_range = [0, 1]
`;

/**
 * Makes a project with files, and with the plugin's options as text.
 * @param {Record<string, string>} files
 * @param {{ options?: string, plugins?: string }} [config]
 */
function plugged(files, { options = "", plugins = "" } = {}) {
  const config = `import { defineConfig } from "vitest/config";
import karat from "karat-vitest";
export default defineConfig({ plugins: [${plugins}karat({ program: ${JSON.stringify(program)}, paths: "cpu", ${options} })] });
`;
  return project({ "vitest.config.js": config, ...files });
}

/**
 * Runs vitest once. Returns its exit code, its output, and its results.
 * @param {string} folder
 * @param {string[]} [words]
 * @param {Record<string, string>} [env]
 */
function run(folder, words = [], env = {}) {
  const report = path.join(folder, "report.json");
  fs.rmSync(report, { force: true });
  const all = [vitest, "run", "--includeTaskLocation", "--reporter=default", "--reporter=json", `--outputFile.json=${report}`, ...words];
  const ran = spawnSync(process.execPath, all, { cwd: folder, encoding: "utf8", env: environment(env), timeout: 120_000 });
  const text = ran.stdout + ran.stderr;
  assert.equal(ran.signal, null, `vitest hangs:\n${text}`);
  const results = fs.existsSync(report) ? JSON.parse(fs.readFileSync(report, "utf8")) : { testResults: [] };
  /** @type {Map<string, any>} */
  const tests = new Map();
  for (const file of results.testResults) {
    for (const one of file.assertionResults) tests.set(one.title, { ...one, file: path.relative(folder, file.name) });
  }
  return { code: ran.status, text, tests };
}

test("tests beside shaders are tests of vitest, where they stand", () => {
  const folder = plugged({
    "shaders/tone.wgsl": SHADER,
    "shaders/tone_test.wgsl": GOOD,
    "shaders/tone.test.toml": DECLARED,
    "own.test.js": 'import { test } from "vitest";\ntest("of its own", () => {});\n',
  });
  const { code, text, tests } = run(folder);
  assert.equal(code, 0, text);
  assert.deepEqual([...tests.keys()].sort(), [
    "modules of shaders are valid", "of its own", "tone::reinhard in_range", "tone_test::half_at_one",
  ]);
  const half = tests.get("tone_test::half_at_one");
  assert.equal(half.file, path.join("shaders", "tone_test.wgsl"));
  assert.equal(half.location.line, 4);
  assert.ok(half.duration > 0, "it has its own time");
  // Without vitest, the plugin isn't in Vite.
  const alone = spawnSync(process.execPath, ["--input-type=module", "-e",
    'import karat from "karat-vitest"; console.log(karat().length)'], { cwd: folder, encoding: "utf8", env: environment({ VITEST: "" }) });
  assert.equal(alone.stdout.trim(), "0", alone.stderr);
});

test("the example passes", () => {
  const example = path.resolve(import.meta.dirname, "../../examples/web");
  const files = ["vitest.config.js", "shaders/fade.wgsl", "shaders/fade_test.wgsl"];
  const texts = files.map((file) => [file, fs.readFileSync(path.join(example, file), "utf8")]);
  const folder = project(Object.fromEntries(texts));
  // This test uses the given program, because the example's copy from npm isn't installed.
  write(folder, "vitest.config.js", texts[0][1].replace("karat()", `karat({ program: ${JSON.stringify(program)}, paths: "cpu" })`));
  const { code, text, tests } = run(folder);
  assert.equal(code, 0, text);
  assert.equal(tests.size, 4, text);
});

test("a failure is at the author's line, with its values", () => {
  const red = GOOD.replace("0.5, 1e-6", "0.75, 1e-6");
  const declared = '[[test]]\nfunction = "wide"\nover = { x = [1, 2, 3] }\nequals = [2, 4, 7]\ntolerance = "1 ulp"\n';
  const folder = plugged({ "shaders/tone.wgsl": SHADER, "shaders/tone_test.wgsl": red, "shaders/tone.test.toml": declared });
  const { code, text, tests } = run(folder, ["--reporter=junit", "--outputFile.junit=junit.xml"]);
  assert.equal(code, 1);
  assert.match(text, /shaders\/tone_test\.wgsl:6:5/);
  assert.match(text, /> +6\||6\| +expect_near\(reinhard\(1\.0\), 0\.75, 1e-6\)/, text);
  assert.match(text, /Expected: +"7"\nReceived: +"6"/, text);
  assert.match(text, /shaders\/tone\.wgsl:5:1/);
  const message = tests.get("tone::wide equals").failureMessages.join();
  assert.match(message, /`tone::wide` fails agrees_with/);
  const junit = fs.readFileSync(path.join(folder, "junit.xml"), "utf8");
  assert.match(junit, /shaders\/tone_test\.wgsl/);
  assert.match(junit, /saw 0\.5, expected 0\.75 within 1e-6/);
});

test("names, bail and shards select as for other tests", () => {
  const red = `${GOOD}\n@test\nfn wrong() {\n    expect_near(reinhard(1.0), 0.6, 0.0);\n}\n`;
  const folder = plugged({ "shaders/tone.wgsl": SHADER, "shaders/tone_test.wgsl": red, "shaders/tone.test.toml": DECLARED });
  const named = run(folder, ["-t", "half_at_one"]);
  assert.equal(named.code, 0, named.text);
  assert.match(named.text, /1 passed \| 4 skipped/);
  const bailed = run(folder, ["--bail=1", "-t", "tone_test", "--no-file-parallelism"]);
  assert.equal(bailed.code, 1);
  const shards = [1, 2].map((at) => [...run(folder, [`--shard=${at}/2`]).tests.keys()]);
  assert.equal(new Set(shards.flat()).size, 4, JSON.stringify(shards));
  assert.ok(shards.every((one) => one.length > 0 && one.length < 4));
});

test("what is no test fails at its place", () => {
  const slip = run(plugged({ "shaders/tone.wgsl": SHADER, "shaders/tone.test.toml": DECLARED.replace("in_range", "in_rnage") }));
  assert.equal(slip.code, 1);
  assert.match(slip.text, /shaders\/tone\.test\.toml:4:1/, slip.text);
  const invalid = run(plugged({
    "shaders/tone.wgsl": SHADER, "shaders/tone_test.wgsl": GOOD, "shaders/other.wgsl": "fn f() -> f32 {\n    return 1u;\n}\n",
  }));
  assert.equal(invalid.code, 1);
  assert.equal(invalid.tests.get("tone_test::half_at_one").status, "passed", invalid.text);
  assert.match(invalid.tests.get("modules of shaders are valid").failureMessages.join(), /shaders\/other\.wgsl:\d/);
  // vitest doesn't load a file with this ending.
  const misnamed = run(plugged({ "shaders/tone.wgsl": SHADER, "shaders/tone_test.wgsl": GOOD, "shaders/tone.tests.toml": DECLARED }));
  assert.equal(misnamed.code, 1, misnamed.text);
  const missing = run(plugged({ "shaders/tone.wgsl": SHADER, "shaders/tone_test.wgsl": GOOD }, { options: 'program: "no-karat"' }));
  assert.equal(missing.code, 1);
  assert.match(missing.text, /no-karat.*npm install --save-dev karat/, missing.text);
  const outside = run(plugged({ "shaders/tone.wgsl": SHADER, "shaders/tone_test.wgsl": GOOD, "more/tone_test.wgsl": GOOD }));
  assert.equal(outside.code, 1);
  assert.match(outside.text, /no test of Karat is in more\/tone_test\.wgsl: it has no/);
});

test("a hung shader, and a process that is killed, fail their tests alone", () => {
  const hung = `${GOOD}\n@test\nfn forever() {\n    var x = 1.0;\n    loop {\n        if (reinhard(x) > 2.0) { break; }\n        x = 1.0;\n    }\n    expect_near(x, 1.0, 0.0);\n}\n`;
  const folder = plugged({ "shaders/tone.wgsl": SHADER, "shaders/tone_test.wgsl": hung, "shaders/tone.test.toml": DECLARED });
  const { code, text, tests } = run(folder, [], { KARAT_TIMEOUT: "2" });
  assert.equal(code, 1);
  assert.equal(tests.get("tone_test::forever").status, "failed", text);
  assert.equal(tests.get("tone::reinhard in_range").status, "passed", text);
  assert.equal(tests.get("tone_test::half_at_one").status, "passed", text);
  // This program exits when it gets a request.
  const dying = path.join(folder, "dying.sh");
  fs.writeFileSync(dying, `#!/bin/sh\nif [ "$1" = suite ]; then read line; kill -9 $$; fi\nexec ${program} "$@"\n`, { mode: 0o755 });
  const killed = run(plugged({ "shaders/tone.wgsl": SHADER, "shaders/tone_test.wgsl": GOOD }, { options: `program: ${JSON.stringify(dying)}` }));
  assert.equal(killed.code, 1);
  assert.match(killed.tests.get("tone_test::half_at_one").failureMessages.join(), /ended \(SIGKILL\)/, killed.text);
});

test("200 tests start one process", () => {
  const many = Array.from({ length: 200 }, (_, i) => `@test\nfn number_${i}() {\n    expect_near(reinhard(1.0), 0.5, 1e-6);\n}\n`);
  const parts = [many.slice(0, 100), many.slice(100)].map((part) => `import package::tone::reinhard;\nimport karat::expect_near;\n${part.join("")}`);
  const counting = path.join(scratch(), "karat.sh");
  fs.writeFileSync(counting, `#!/bin/sh\necho "$1" >> "$0.log"\nexec ${program} "$@"\n`, { mode: 0o755 });
  const folder = plugged(
    { "shaders/tone.wgsl": SHADER, "shaders/one_test.wgsl": parts[0], "shaders/two_test.wgsl": parts[1] },
    { options: `program: ${JSON.stringify(counting)}` },
  );
  const began = Date.now();
  const { code, text, tests } = run(folder);
  assert.equal(code, 0, text.slice(-2000));
  assert.equal(tests.size, 201);
  const started = fs.readFileSync(`${counting}.log`, "utf8").trim().split("\n").sort();
  assert.deepEqual(started, ["list", "suite"]);
  const own = [...tests.values()].reduce((sum, one) => sum + one.duration, 0);
  console.log(`200 tests: ${Date.now() - began} ms, of which Karat took ${Math.round(own)}`);
});

test("--update accepts frames, and never in CI", () => {
  const shader = "@fragment fn red(@location(0) uv: vec2f) -> @location(0) vec4f { return vec4f(uv, 0.0, 1.0); }\n";
  const frame = '[[frame]]\nname = "red"\nfragment = "red"\nsize = [8, 4]\n';
  const folder = plugged({ "shaders/tone.wgsl": shader, "shaders/tone.test.toml": frame }, { options: 'paths: "vulkan"' });
  const first = run(folder);
  assert.equal(first.code, 1);
  assert.match(first.text, /frame `red` has no golden/);
  assert.equal(run(folder, ["--update"], { CI: "true" }).code, 1, "CI accepts nothing");
  const updated = run(folder, ["--update"]);
  assert.equal(updated.code, 0, updated.text);
  assert.equal(run(folder).code, 0);
  write(folder, "shaders/tone.wgsl", shader.replace("uv, 0.0", "uv, 0.5"));
  assert.equal(run(folder).code, 1, "the golden is another");
});

test("a plugin that makes texts of shaders changes no test", () => {
  const texts = '{ name: "texts", transform: (code, id) => id.endsWith(".wgsl") ? `export default ${JSON.stringify(code)}` : null }, ';
  const files = { "shaders/tone.wgsl": SHADER, "shaders/tone_test.wgsl": GOOD.replace("0.5, 1e-6", "0.75, 1e-6") };
  const { code, tests, text } = run(plugged(files, { plugins: texts }));
  assert.equal(code, 1, text);
  assert.equal(tests.get("tone_test::half_at_one").status, "failed", text);
});

test("watching reruns what an edit concerns", async () => {
  const folder = plugged({
    "shaders/tone.wgsl": SHADER, "shaders/tone_test.wgsl": GOOD,
    "shaders/grey.wgsl": "fn grey(x: f32) -> f32 { return 0.5 * x; }\n",
    "shaders/grey_test.wgsl": GOOD.replaceAll("tone", "grey").replaceAll("reinhard", "grey").replace("half_at_one", "half"),
  });
  const watching = spawn(process.execPath, [vitest, "--watch", "--reporter=verbose"], { cwd: folder, env: environment({}) });
  let text = "";
  watching.stdout.on("data", (part) => (text += part));
  watching.stderr.on("data", (part) => (text += part));
  /** @param {number} count */
  const runs = async (count) => {
    const end = Date.now() + 60_000;
    while ((text.match(/Duration/g) ?? []).length < count) {
      assert.ok(Date.now() < end, `no run ${count}:\n${text}`);
      await new Promise((resolve) => setTimeout(resolve, 50));
    }
    const own = text.split(/Duration/)[count - 1].split("RERUN").at(-1) ?? "";
    // Watchers start a moment after the first run.
    await new Promise((resolve) => setTimeout(resolve, 1000));
    return own;
  };
  try {
    assert.match(await runs(1), /half_at_one/);
    write(folder, "shaders/tone.wgsl", SHADER.replace("1.0 + luminance", "2.0 + luminance"));
    const red = await runs(2);
    assert.match(red, /tone_test::half_at_one/);
    assert.match(red, /1 failed/);
    assert.doesNotMatch(red, /grey_test::half/, "it doesn't read this file");
    write(folder, "shaders/tone.wgsl", SHADER);
    assert.doesNotMatch(await runs(3), /failed/);
  } finally {
    watching.kill("SIGINT");
    await new Promise((resolve) => watching.on("close", resolve));
  }
});
