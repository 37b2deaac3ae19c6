// The path `dawn`: Dawn, the WebGPU of Chrome, in Node, from the npm package `webgpu`. The argument is the package's
// folder. `jobs.js`, which runs jobs, comes before this text, and Node reads both from its command line.
//
// It writes a greeting, and an answer for each job, to stdout, one line each. Dawn logs on stdout and stderr, so it
// runs in a process of its own, whose answers come on a third stream.

import { spawn } from 'node:child_process';
import { writeSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join, resolve } from 'node:path';
import { createInterface } from 'node:readline';
import { pathToFileURL } from 'node:url';

const [folder, inner] = process.argv.slice(1);
if (inner) {
    await serve(pathToFileURL(join(resolve(folder), 'index.js')));
} else {
    const streams = ['inherit', 2, 2, 1];
    spawn(process.execPath, [...process.execArgv, '--', folder, 'inner'], { stdio: streams })
        .on('exit', (code) => process.exit(code ?? 1));
}

async function serve(index) {
    const { create, globals } = await import(index);
    Object.assign(globalThis, globals);
    // Dawn is destroyed with its last reference.
    globalThis.gpu = create([]);
    const { version } = createRequire(index)('./package.json');
    const { device, greeting } = await opened(gpu, 'Dawn');
    // Karat then starts another process.
    device.lost.then(() => process.exit(1));
    say({ ...greeting, driver: `webgpu ${version}` });
    for await (const line of createInterface({ input: process.stdin })) {
        say(await answered(device, JSON.parse(line)));
    }
    process.exit(0);
}

function say(message) {
    const bytes = Buffer.from(`${JSON.stringify(message)}\n`);
    for (let at = 0; at < bytes.length;) at += writeSync(3, bytes, at);
}
