// @ts-check
// Runs in a worker of vitest. It declares tests, and asks the main process for their verdicts.

import net from "node:net";
import path from "node:path";
import readline from "node:readline";
import { test } from "vitest";

/** @typedef {import("./karat.js").Listed} Listed */
/** @typedef {import("./karat.js").Verdict} Verdict */
/** @typedef {import("./karat.js").Question} Question */

/** The timeout in milliseconds. Karat ends a hung test itself and reports it, so vitest waits a while longer. */
const TIMEOUT = 1000 * (Number(process.env.KARAT_TIMEOUT) || 20) + 40_000;

/** @type {Promise<net.Socket> | undefined} */
let opened;
/** @type {Map<number, (answer: Verdict) => void>} */
const waiting = new Map();
let last = 0;

function open() {
  opened ??= new Promise((resolve, reject) => {
    const socket = net.createConnection(process.env.VITEST_KARAT ?? "");
    const lost = (/** @type {string} */ why) => {
      opened = undefined;
      for (const answer of waiting.values()) answer({ message: `can't reach vitest's main process: ${why}` });
      waiting.clear();
    };
    readline.createInterface({ input: socket }).on("line", (line) => {
      const { id, answer } = JSON.parse(line);
      waiting.get(id)?.(answer);
      waiting.delete(id);
    });
    socket.on("connect", () => resolve(socket));
    socket.on("close", () => lost("the connection is closed"));
    socket.on("error", (error) => {
      lost(error.message);
      reject(error);
    });
    socket.unref();
  });
  return opened;
}

/**
 * @param {Question} question
 * @returns {Promise<Verdict>}
 */
async function ask(question) {
  const socket = await open();
  const id = ++last;
  // A connection without a pending question doesn't keep the worker alive.
  socket.ref();
  const answer = await new Promise((/** @type {(answer: Verdict) => void} */ resolve) => {
    waiting.set(id, resolve);
    socket.write(`${JSON.stringify({ id, question })}\n`);
  });
  if (waiting.size === 0) socket.unref();
  return answer;
}

/** Returns `true` under `vitest --update`. CI accepts nothing. */
function accepts() {
  const worker = /** @type {any} */ (globalThis).__vitest_worker__;
  return !process.env.CI && worker?.config?.snapshotOptions?.updateSnapshot === "all";
}

/**
 * Makes an error whose stack has the author's line first, then the line of the test.
 * @param {Verdict} verdict
 * @param {string} name
 * @param {string} [own]
 */
function failure({ message = "", place, actual, expected }, name, own) {
  const error = new Error(message.replace(/^error: /, ""));
  const frames = [...new Set([place, own])].filter(Boolean);
  const at = name.replaceAll(/[\s()]+/g, "_");
  if (frames.length > 0) error.stack = `Error: ${error.message}${frames.map((frame) => `\n    at ${at} (${frame})`).join("")}`;
  return expected === undefined ? error : Object.assign(error, { actual, expected });
}

/**
 * Declares a test.
 * @param {Listed} listed
 */
export function declare({ package: folder, name, file, line, column }) {
  test(name, { timeout: TIMEOUT }, async () => {
    const verdict = await ask({ folder, name, accept: accepts() });
    if (verdict.message) throw failure(verdict, name, `${file}:${line}:${column}`);
  });
}

/**
 * Declares a failing test for an unreadable test or file.
 * @param {Listed} listed
 */
export function broken({ name, file, line, column, error }) {
  test(name, () => {
    throw failure({ message: error?.message, place: `${file}:${line}:${column}` }, name);
  });
}

/**
 * Declares the test that the modules of a folder are valid, even if no test uses them.
 * @param {string} folder
 */
export function valid(folder) {
  const name = `modules of ${path.relative(process.cwd(), folder) || "this folder"} are valid`;
  test(name, { timeout: TIMEOUT }, async () => {
    const verdict = await ask({ folder });
    if (verdict.message) throw failure(verdict, name);
  });
}

/**
 * Declares a failing test, because the file has no tests.
 * @param {string} message
 */
export function failing(message) {
  test("karat", () => {
    throw failure({ message }, "karat");
  });
}
