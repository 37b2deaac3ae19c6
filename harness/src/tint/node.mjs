// The process that keeps running. It reads questions from stdin, and writes answers to stderr, one in each line. Dawn
// logs on stdout. The process ends by SIGKILL, because Dawn hangs or crashes during a normal exit.
const { createInterface } = await import('node:readline');
const { pathToFileURL } = await import('node:url');
const { readFileSync, writeSync } = await import('node:fs');
const { join } = await import('node:path');
const say = (value) => {
  let bytes = Buffer.from(JSON.stringify(value) + '\n');
  while (bytes.length) {
    try { bytes = bytes.subarray(writeSync(2, bytes)); } catch (error) { if (error.code !== 'EAGAIN') end(); }
  }
};
const end = () => process.kill(process.pid, 'SIGKILL');
let gpu;
try {
  const [major] = process.versions.node.split('.');
  if (Number(major) < 20) throw new Error(`Node ${process.versions.node} is too old: install Node 20 or newer`);
  const folder = process.argv[1];
  const about = JSON.parse(readFileSync(join(folder, 'package.json'), 'utf8'));
  const { create, globals } = await import(pathToFileURL(join(folder, about.main ?? 'index.js')));
  Object.assign(globalThis, globals);
  // Uses no driver, because only Tint's front end is needed.
  gpu = create(['backend=null']);
  await deviceOf(gpu, false);
  say({ version: `webgpu ${about.version}, Node ${process.versions.node}` });
} catch (error) {
  say({ error: String(error?.message ?? error) });
  end();
}
for await (const line of createInterface({ input: process.stdin })) say(await judge(gpu, JSON.parse(line)));
end();
