// Runs Karat's jobs in Dawn, the WebGPU of Chrome, by the npm package `webgpu`:
//
//   KARAT_EXECUTORS='dawn=node dawn.mjs node_modules/webgpu' KARAT_PATHS=process@dawn cargo test
//
// The first line that it writes is a greeting; then it reads a job a line, and writes an answer a line.
// `jobs.schema.json` describes the data, and `karat doctor --executor dawn` asks it jobs with known answers. Where Dawn
// finds no adapter, VK_ICD_FILENAMES names the driver: /usr/lib/chromium/vk_swiftshader_icd.json is SwiftShader's.

import { spawn } from 'node:child_process';
import { writeSync } from 'node:fs';
import { join, resolve } from 'node:path';
import { createInterface } from 'node:readline';
import { pathToFileURL } from 'node:url';

const [folder, inner] = process.argv.slice(2);
if (!inner) {
    // Dawn logs on stdout, so that replies of the inner process come on a third stream.
    const streams = ['inherit', 2, 2, 1];
    spawn(process.execPath, [process.argv[1], folder, 'inner'], { stdio: streams })
        .on('exit', (code) => process.exit(code ?? 1));
} else {
    await serve();
}

async function serve() {
    const { create, globals } = await import(pathToFileURL(join(resolve(folder), 'index.js')));
    Object.assign(globalThis, globals);
    // Dawn goes with its last reference.
    globalThis.gpu = create([]);
    const adapter = await gpu.requestAdapter();
    if (!adapter) throw new Error('Dawn finds no adapter');
    const f16 = adapter.features.has('shader-f16');
    const wanted = ['shader-f16', 'float32-filterable'].filter((name) => adapter.features.has(name));
    const { maxStorageBufferBindingSize, maxBufferSize } = adapter.limits;
    const device = await adapter.requestDevice({
        requiredFeatures: wanted,
        requiredLimits: { maxStorageBufferBindingSize, maxBufferSize },
    });
    // Karat starts another process.
    device.lost.then(() => process.exit(1));
    const { vendor, architecture, description } = adapter.info;
    say({
        jobs: 1,
        name: `Dawn on ${description || `${vendor} ${architecture}`}`,
        software: adapter.info.isFallbackAdapter ?? false,
        can: f16 ? ['f16', 'textures'] : ['textures'],
    });
    for await (const line of createInterface({ input: process.stdin })) {
        device.pushErrorScope('validation');
        device.pushErrorScope('out-of-memory');
        const job = JSON.parse(line);
        const reply = await run(device, job).catch((error) => {
            const { message, pass = 0, bytes = null, refused = false } = error;
            return { [refused ? 'refused' : 'failed']: { message, pass, bytes } };
        });
        const [first, second] = [await device.popErrorScope(), await device.popErrorScope()];
        const wrong = first ?? second;
        // A shader that was taken isn't refused.
        const failed = wrong && reply.done && { failed: { message: wrong.message } };
        say({ id: job.id, reply: failed || reply });
    }
    process.exit(0);
}

function say(message) {
    const bytes = Buffer.from(`${JSON.stringify(message)}\n`);
    for (let at = 0; at < bytes.length;) at += writeSync(3, bytes, at);
}

// An error of the shader: nothing has run.
function refusal(message, pass, bytes) {
    return Object.assign(new Error(message), { refused: true, pass, bytes });
}

async function run(device, { jobs, resources, outputs, work }) {
    if (jobs !== 1) throw new Error(`it reads jobs of version 1, and not ${jobs}`);
    if (!work.passes) throw refusal('it draws no frames', 0);
    const held = resources.map((resource) => hold(device, resource));
    const encoder = device.createCommandEncoder();
    for (const [number, pass] of work.passes.entries()) {
        const { wgsl, overrides } = pass.shader;
        const module = device.createShaderModule({ code: wgsl });
        const { messages } = await module.getCompilationInfo();
        const wrong = messages.find(({ type }) => type === 'error');
        if (wrong) {
            // Offsets of JavaScript's texts are in UTF-16.
            const byte = (offset) => Buffer.byteLength(wgsl.slice(0, offset));
            const { message, offset, length } = wrong;
            throw refusal(message, number, { start: byte(offset), end: byte(offset + length) });
        }
        const pipeline = await device.createComputePipelineAsync({
            layout: 'auto',
            compute: { module, entryPoint: pass.entry_point, constants: overrides },
        }).catch((error) => { throw refusal(error.message, number); });
        const dispatch = encoder.beginComputePass();
        dispatch.setPipeline(pipeline);
        for (const group of new Set(pass.bindings.map(({ at }) => at[0]))) {
            const layout = pipeline.getBindGroupLayout(group);
            const own = pass.bindings.filter(({ at }) => at[0] === group);
            const entries = own.map(({ at, resource }) => ({ binding: at[1], resource: bound(held[resource]) }));
            dispatch.setBindGroup(group, device.createBindGroup({ layout, entries }));
        }
        dispatch.dispatchWorkgroups(...pass.workgroups);
        dispatch.end();
    }
    const staged = outputs.map((number) => {
        if (!held[number].buffer) throw new Error('it reads no textures back');
        const { buffer } = held[number];
        const usage = GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST;
        const staging = device.createBuffer({ size: buffer.size, usage });
        encoder.copyBufferToBuffer(buffer, 0, staging, 0, buffer.size);
        return staging;
    });
    device.queue.submit([encoder.finish()]);
    const done = [];
    for (const staging of staged) {
        await staging.mapAsync(GPUMapMode.READ);
        done.push(Array.from(new Uint32Array(staging.getMappedRange())));
        staging.destroy();
    }
    held.forEach((one) => (one.buffer ?? one.texture)?.destroy());
    return { done };
}

function bound({ buffer, texture, view, sampler }) {
    return sampler ?? (texture ? texture.createView(view) : { buffer });
}

function hold(device, { buffer, texture, sampler }) {
    if (sampler) {
        const [addressModeU, addressModeV, addressModeW] = sampler.address;
        const [lodMinClamp, lodMaxClamp] = sampler.lod;
        const { mag: magFilter, min: minFilter, mip: mipmapFilter, anisotropy: maxAnisotropy } = sampler;
        const compare = sampler.compare ?? undefined;
        const filters = { magFilter, minFilter, mipmapFilter, maxAnisotropy, compare };
        return { sampler: device.createSampler({
            addressModeU, addressModeV, addressModeW, lodMinClamp, lodMaxClamp, ...filters,
        }) };
    }
    if (buffer) {
        const words = new Uint32Array(buffer.words);
        const { STORAGE, UNIFORM, COPY_SRC, COPY_DST } = GPUBufferUsage;
        const usage = STORAGE | UNIFORM | COPY_SRC | COPY_DST;
        const made = device.createBuffer({ size: Math.max(words.byteLength, 4), usage });
        device.queue.writeBuffer(made, 0, words);
        return { buffer: made };
    }
    const { dimension, arrayed, texels, samples, levels } = texture.texture;
    if (texture.format || texels === 'depth' || samples > 1) {
        throw refusal('it has no storage textures, depths or samples', 0);
    }
    const [{ width, height, depth, words }] = levels;
    const layers = words.length / (width * height);
    const made = device.createTexture({
        size: [width, height, layers],
        mipLevelCount: levels.length,
        dimension: dimension === 'cube' ? '2d' : dimension,
        format: { float: 'rgba32float', sint: 'rgba32sint', uint: 'rgba32uint' }[texels],
        usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST,
    });
    levels.forEach((level, mipLevel) => device.queue.writeTexture(
        { texture: made, mipLevel },
        new Uint32Array(level.words.flat()),
        { bytesPerRow: 16 * level.width, rowsPerImage: level.height },
        [level.width, level.height, level.depth * (layers / depth)],
    ));
    return { texture: made, view: { dimension: arrayed ? `${dimension}-array` : dimension } };
}
