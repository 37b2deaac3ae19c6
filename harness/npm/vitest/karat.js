// @ts-check
// The processes of Karat for vitest, and a socket for vitest's workers. Each folder of shaders has one process, which
// keeps running.

import { spawn } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import net from "node:net";
import os from "node:os";
import path from "node:path";
import readline from "node:readline";

import { installed } from "./installed.js";

/**
 * A test, or an unreadable file or test.
 * @typedef {{ package: string, name: string, file: string, line: number, column: number, error: Wrong | null }} Listed
 */

/**
 * @typedef {{ headline: string, place: string | null, message: string }} Wrong
 */

/**
 * A verdict for a worker of vitest.
 * @typedef {{ message?: string, place?: string, actual?: string, expected?: string, pending?: boolean }} Verdict
 */

/**
 * A request to run a test, or to check that the modules of a folder are valid. `accept` makes the drawn frame the
 * golden.
 * @typedef {{ folder: string, name?: string, accept?: boolean }} Question
 */

/**
 * Checks if vitest loads a file as tests of Karat.
 * @param {string} file
 */
export const isTest = (file) => /(_test\.(wgsl|wesl)|\.test\.toml)$/.test(file);

/** The program doesn't exist. */
export class Missing extends Error {}

/**
 * The time in seconds after which Karat ends a hung shader, unless `KARAT_TIMEOUT` sets another time.
 */
const TIMEOUT = "20";

/** A process of `karat suite --serve`. Its requests run one after the other. */
class Resident {
  /** @type {import("node:child_process").ChildProcess | undefined} */
  child;
  /** @type {Promise<unknown>} */
  turn = Promise.resolve();
  /** The last verdict of each test: the process skips tests that an edit doesn't affect. @type {Map<string, Wrong | null>} */
  verdicts = new Map();
  /** Files that each test read. @type {Map<string, Set<string>>} */
  reads = new Map();
  /** @type {{ said: (line: any) => void, ended: (why: string) => void } | undefined} */
  heard;

  /**
   * @param {Karat} karat
   * @param {string} folder
   */
  constructor(karat, folder) {
    this.karat = karat;
    this.folder = folder;
  }

  start() {
    const { karat } = this;
    const env = { ...karat.env(), KARAT_RECORD: mkdtempSync(path.join(karat.scratch, "record-")) };
    const child = spawn(karat.program, ["suite", this.folder, "--serve"], { cwd: karat.root, env });
    this.child = child;
    this.verdicts.clear();
    let last = "";
    child.stderr?.setEncoding("utf8").on("data", (text) => {
      last = (last + text).slice(-4096);
    });
    readline.createInterface({ input: /** @type {any} */ (child.stdout) }).on("line", (line) => {
      // Other lines are output of a driver.
      if (!line.startsWith("{")) return;
      try {
        this.heard?.said(JSON.parse(line));
      } catch {}
    });
    const ended = (/** @type {string} */ why) => {
      if (this.child !== child) return;
      this.child = undefined;
      this.heard?.ended(last.trim() || why);
    };
    child.on("error", (error) => ended(`${karat.program} doesn't run: ${error.message}`));
    child.on("close", (status, signal) => ended(`the process that runs the tests ended (${signal ?? `exit code ${status}`})`));
    child.stdin?.on("error", () => {});
  }

  /**
   * @param {object} request
   * @returns {Promise<any>} Its last answer.
   */
  ask(request) {
    const asked = this.turn.then(() => new Promise((resolve, reject) => {
      if (!this.child) this.start();
      this.heard = {
        said: (line) => {
          if (line.test) this.verdicts.set(line.test.name, line.test.wrong);
          if (line.done) resolve(line.done);
        },
        ended: (why) => reject(new Error(why)),
      };
      const whole = { filter: "", all: false, first: [], ...request };
      this.child?.stdin?.write(`${JSON.stringify(whole)}\n`);
    })).finally(() => {
      this.heard = undefined;
    });
    this.turn = asked.catch(() => {});
    return asked;
  }
}

/** Karat for one run of vitest. */
export class Karat {
  /** @type {Map<string, Resident>} */
  residents = new Map();
  /** @type {Promise<Listed[]> | undefined} */
  listed;
  /** Files that changed since the last request to each folder. @type {Set<string>} */
  changed = new Set();
  /** @type {net.Server | undefined} */
  server;
  // The path of a socket has at most about a hundred bytes.
  scratch = mkdtempSync(path.join(os.tmpdir().length < 64 || process.platform === "win32" ? os.tmpdir() : "/tmp", "karat-vitest-"));

  /**
   * @param {string} root
   * @param {import("./index.d.ts").KaratOptions} options
   */
  constructor(root, options) {
    this.root = root;
    this.options = options;
    this.program = options.program ?? installed(root) ?? "karat";
    process.once("exit", () => this.close());
  }

  env() {
    const { paths } = this.options;
    return { KARAT_TIMEOUT: TIMEOUT, ...process.env, ...(paths ? { KARAT_PATHS: paths } : {}) };
  }

  /**
   * Runs the program once, and returns its output.
   * @param {string[]} words
   * @returns {Promise<{ status: number | null, out: string, err: string }>}
   */
  run(words) {
    return new Promise((resolve, reject) => {
      const child = spawn(this.program, words, { cwd: this.root, env: this.env() });
      let [out, err] = ["", ""];
      child.stdout.setEncoding("utf8").on("data", (text) => (out += text));
      child.stderr.setEncoding("utf8").on("data", (text) => (err += text));
      child.on("error", (error) => reject(new Missing(
        `the program \`${this.program}\` doesn't run (${error.message}): install it with npm install --save-dev karat`,
      )));
      child.on("close", (status) => resolve({ status, out, err }));
    });
  }

  /** All tests. After an edit they are listed again. */
  list() {
    this.listed ??= (async () => {
      const folders = this.options.folders ?? [undefined];
      const all = await Promise.all(folders.map(async (folder) => {
        const { out, err } = await this.run(["list", "--tests", "--json", ...(folder ? [folder] : [])]);
        if (!out.startsWith("[")) throw new Error(err.trim() || "`karat list --tests` prints nothing");
        return JSON.parse(out);
      }));
      // The list may have a folder twice.
      const key = (/** @type {Listed} */ one) => `${one.package}\n${one.file}\n${one.name}`;
      return [...new Map(all.flat().map((one) => [key(one), one])).values()];
    })();
    return this.listed;
  }

  /** @param {string} file */
  forget(file) {
    this.listed = undefined;
    this.changed.add(file);
  }

  /**
   * Returns the test files to rerun after an edit of a file: the same file, files with a test that read it, and files
   * that haven't run. If no test reads a module, this is one file, which checks that all modules are valid.
   * @param {string} file
   * @param {string[]} tests
   */
  concerned(file, tests) {
    const edited = path.resolve(file);
    this.forget(edited);
    const of = (/** @type {string} */ file) => [...this.residents.values()].find((one) => isBelow(file, one.folder));
    const found = tests.filter((test) => {
      if (test === edited) return true;
      const reads = of(test)?.reads.get(test);
      return reads ? reads.has(edited) : true;
    });
    const folder = of(edited)?.folder;
    if (found.length > 0 || !folder || !/\.(wgsl|wesl|toml)$/.test(edited)) return found;
    return tests.filter((test) => isBelow(test, folder)).slice(0, 1);
  }

  /** @param {string} folder */
  resident(folder) {
    const known = this.residents.get(folder) ?? new Resident(this, folder);
    this.residents.set(folder, known);
    return known;
  }

  /**
   * @param {Question} question
   * @returns {Promise<Verdict>}
   */
  async answer({ folder, name, accept }) {
    const resident = this.resident(folder);
    const changed = [...this.changed];
    if (name === undefined) {
      const done = await resident.ask({ only: "", validate: true, changed });
      if (done.invalid) return { message: done.invalid, place: placeIn(done.invalid, this.root) };
      // Tests in files that vitest doesn't load would never run.
      const other = (await this.list()).find((one) => one.package === folder && !isTest(one.file));
      if (!other) return {};
      const place = `${other.file}:${other.line}:${other.column}`;
      if (other.error) return { message: other.error.message, place };
      return { message: `\`${other.name}\` is in a file that vitest doesn't load: move it to a file that ends with _test.wgsl`, place };
    }
    const done = await resident.ask({ only: name, changed });
    const listed = (await this.list()).find((one) => one.package === folder && one.name === name);
    const record = done.records?.at(-1);
    if (listed) {
      const reads = resident.reads.get(listed.file) ?? new Set();
      for (const { file } of (done.records ?? []).flatMap((/** @type {any} */ one) => one.read ?? [])) reads.add(file);
      resident.reads.set(listed.file, reads);
    }
    if (!done.tests.includes(name)) {
      // An unreadable file has no tests.
      resident.verdicts.delete(name);
      const own = (/** @type {Wrong} */ one) => listed && one.place && path.resolve(this.root, one.place).startsWith(listed.file);
      const wrong = done.broken.find(own) ?? done.broken[0];
      return wrong ? verdict(wrong, undefined, this.root) : { message: `no test of Karat is called \`${name}\` any more` };
    }
    if (!resident.verdicts.has(name)) return { message: `test \`${name}\` has no verdict` };
    const wrong = resident.verdicts.get(name);
    if (!wrong) return {};
    const frame = name.startsWith("frame ") ? name.slice("frame ".length) : undefined;
    const goldens = record?.subject?.folder;
    if (frame && accept && goldens) {
      const { status, err } = await this.run(["accept", frame, "--goldens", goldens, "--because", "vitest --update"]);
      resident.verdicts.delete(name);
      if (status === 0) return this.answer({ folder, name });
      wrong.message += `\n\nthe frame can't be accepted: ${err.trim()}`;
    }
    return verdict(wrong, record, this.root);
  }

  /** Answers the workers of vitest, with a line of JSON for each request. */
  serve() {
    return new Promise((/** @type {(place: string) => void} */ resolve, reject) => {
      const place = process.platform === "win32"
        ? `\\\\.\\pipe\\${path.basename(this.scratch)}`
        : path.join(this.scratch, "socket");
      if (this.server) return resolve(place);
      this.server = net.createServer((socket) => {
        socket.on("error", () => {});
        readline.createInterface({ input: socket }).on("line", async (line) => {
          const { id, question } = JSON.parse(line);
          const answer = await this.answer(question).catch((error) => ({ message: String(error.message ?? error) }));
          socket.write(`${JSON.stringify({ id, answer })}\n`);
        });
      });
      this.server.on("error", reject);
      // The server doesn't keep the process alive.
      this.server.listen(place, () => resolve(place)).unref();
    });
  }

  close() {
    for (const { child } of this.residents.values()) child?.kill();
    this.residents.clear();
    this.server?.close();
    rmSync(this.scratch, { recursive: true, force: true });
  }
}

/**
 * @param {string} file
 * @param {string} folder
 */
function isBelow(file, folder) {
  return file === folder || file.startsWith(folder.endsWith(path.sep) ? folder : folder + path.sep);
}

/**
 * Returns the location in a message: `  --> shaders/a.wgsl:3:1`.
 * @param {string} message
 * @param {string} root
 */
function placeIn(message, root) {
  const place = message.match(/^\s*--> (.+:\d+:\d+)/m)?.[1];
  return place && path.resolve(root, place);
}

/**
 * @param {Wrong} wrong
 * @param {any} record
 * @param {string} root
 * @returns {Verdict}
 */
function verdict(wrong, record, root) {
  const paths = record?.details?.paths ?? [];
  const cases = paths.flatMap((/** @type {any} */ one) => [one.simplest, one.worst, one.first]).filter(Boolean);
  const expectation = cases.flatMap((/** @type {any} */ one) => one.expectations ?? [])[0];
  const told = expectation?.place || wrong.place || record?.details?.place;
  const place = told ? path.resolve(root, told) : placeIn(wrong.message, root);
  const valued = cases.find((/** @type {any} */ one) => one.actual && one.expected);
  const values = valued && { actual: valued.actual, expected: valued.expected };
  return { message: wrong.message.trim(), place, ...values };
}
