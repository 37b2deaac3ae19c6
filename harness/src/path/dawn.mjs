// The path `dawn`: Chrome's WebGPU in Node, from the npm package `webgpu`. Node gets this script, after the text of
// `jobs.js`, on its command line. The script's argument is the folder of the package.
//
// The script writes a greeting line and a reply line for each job to stdout. Dawn also logs on stdout and stderr. So
// Dawn runs in a second process, whose replies come on a third stream.

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
    // Keeps a reference, because Dawn is destroyed with its last reference.
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
