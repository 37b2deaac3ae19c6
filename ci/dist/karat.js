#!/usr/bin/env node
// Runs the program of this machine, which is in a package of its own: nothing is downloaded when this is installed.
"use strict";
const { spawnSync } = require("node:child_process");

const own = `karat-${process.platform}-${process.arch}`;
const file = process.platform === "win32" ? "karat.exe" : "karat";

let program;
try {
  program = require.resolve(`${own}/bin/${file}`);
} catch {
  console.error(
    `karat: the package ${own} isn't here. Install without --omit=optional; if there is no such package, ` +
      "build karat with Rust, from its repository: cargo install --path harness/cli",
  );
  process.exit(2);
}

const ran = spawnSync(program, process.argv.slice(2), { stdio: "inherit" });
if (ran.error) {
  console.error(`karat: ${program} doesn't run: ${ran.error.message}`);
  process.exit(2);
}
// Who is ended by a signal ends so, too.
if (ran.signal) process.kill(process.pid, ran.signal);
process.exit(ran.status ?? 2);
