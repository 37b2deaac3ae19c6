#!/usr/bin/env node
// Runs the program for this machine, which has its own package: installing this package downloads nothing.
"use strict";
const { spawn } = require("node:child_process");

const own = `karat-${process.platform}-${process.arch}`;
const file = process.platform === "win32" ? "karat.exe" : "karat";

let program;
try {
  program = require.resolve(`${own}/bin/${file}`);
} catch {
  console.error(
    `karat: the package ${own} isn't here. Install it, too: from the archives of a release give npm both; from a ` +
      "registry leave --omit=optional out. Where there is none for this system, Rust builds karat from its repository.",
  );
  process.exit(2);
}

const running = spawn(program, process.argv.slice(2), { stdio: "inherit" });
running.on("error", (error) => {
  console.error(`karat: ${program} doesn't run: ${error.message}`);
  process.exit(2);
});
// A signal that ends this script ends the program. A terminal sends Ctrl-C to both already.
for (const signal of ["SIGINT", "SIGTERM", "SIGHUP"]) {
  process.on(signal, () => signal === "SIGINT" && process.stdin.isTTY || running.kill(signal));
}
running.on("exit", (status, signal) => {
  if (signal) {
    // This script ends by the program's signal, too.
    process.removeAllListeners(signal);
    process.kill(process.pid, signal);
  } else process.exit(status ?? 2);
});
