// Runs Karat's jobs with WebGPU: in Node on Dawn (`dawn.mjs`), or in a page of Chromium. `jobs.schema.json` describes
// the data.

// Opens a device with all features that jobs may need, and makes the greeting.
async function opened(gpu, name) {
    const adapter = await gpu.requestAdapter();
    if (!adapter) {
        throw new Error('WebGPU finds no adapter: install a driver for Vulkan 1.3, or Chromium, which contains SwiftShader');
    }
    const features = ['depth32float-stencil8', 'float32-filterable', 'float32-blendable', 'shader-f16', 'subgroups'];
    const { maxStorageBufferBindingSize, maxBufferSize } = adapter.limits;
    const device = await adapter.requestDevice({
        requiredFeatures: features.filter((feature) => adapter.features.has(feature)),
        requiredLimits: { maxStorageBufferBindingSize, maxBufferSize },
    });
    const { info } = adapter;
    const able = { f16: 'shader-f16', subgroups: 'subgroups' };
    const can = Object.keys(able).filter((ability) => device.features.has(able[ability]));
    const greeting = {
        jobs: 1,
        name: `${name} on ${info.description || `${info.vendor} ${info.architecture}`}`,
        software: info.isFallbackAdapter || /swiftshader|llvmpipe/i.test(`${info.description} ${info.architecture}`),
        can: [...can, 'textures', 'frames', 'packed'],
    };
    return { device, greeting };
}

// The reply to a job, including errors.
async function answered(device, job) {
    device.pushErrorScope('validation');
    device.pushErrorScope('out-of-memory');
    const reply = await run(device, job).catch((error) => {
        const { message, pass = 0, bytes = null, refused = false } = error;
        return { [refused ? 'refused' : 'failed']: { message, pass, bytes } };
    });
    const [first, second] = [await device.popErrorScope(), await device.popErrorScope()];
    const wrong = first ?? second;
    // The compiler accepted the shader, so the job failed instead of being refused.
    const failed = wrong && reply.done && { failed: { message: wrong.message } };
    return { id: job.id, reply: failed || reply };
}

// Makes an error which says that the shader was refused before any part of the shader ran.
function refusal(message, pass, bytes) {
    return Object.assign(new Error(message), { refused: true, pass, bytes });
}

// Compiles a module. Throws a refusal if the compiler rejects it.
async function compiled(device, wgsl, number) {
    const module = device.createShaderModule({ code: wgsl });
    const { messages } = await module.getCompilationInfo();
    const wrong = messages.find(({ type }) => type === 'error');
    if (wrong) {
        // JavaScript's offsets count UTF-16 units.
        const byte = (offset) => new TextEncoder().encode(wgsl.slice(0, offset)).length;
        const { message, offset, length } = wrong;
        throw refusal(message, number, { start: byte(offset), end: byte(offset + length) });
    }
    return module;
}

// Stores pipelines. Each key contains the shader's text. A function's cases come in many jobs, and compiling takes
// longer than running.
const pipelines = new Map();
const MOST_PIPELINES = 32;

async function pipelineOf(device, { shader: { wgsl, overrides }, entry_point: entryPoint }, number) {
    const key = JSON.stringify([entryPoint, overrides, wgsl]);
    let pipeline = pipelines.get(key);
    if (!pipeline) {
        const module = await compiled(device, wgsl, number);
        pipeline = await device.createComputePipelineAsync({
            layout: 'auto',
            compute: { module, entryPoint, constants: overrides },
        }).catch((error) => { throw refusal(error.message, number); });
        // Removes the oldest pipeline.
        if (pipelines.size >= MOST_PIPELINES) pipelines.delete(pipelines.keys().next().value);
        pipelines.set(key, pipeline);
    }
    return pipeline;
}

// Binds the resources of a pass or a draw, group by group.
function bind(device, pipeline, pass, bindings, held) {
    if (bindings.some(({ at }) => !at)) throw refusal('WebGPU has no immediates', 0);
    for (const group of new Set(bindings.map(({ at }) => at[0]))) {
        const layout = pipeline.getBindGroupLayout(group);
        const own = bindings.filter(({ at }) => at[0] === group);
        const entries = own.map(({ at, resource }) => ({ binding: at[1], resource: bound(held[resource]) }));
        pass.setBindGroup(group, device.createBindGroup({ layout, entries }));
    }
}

async function run(device, { jobs, resources, outputs, work }) {
    if (jobs !== 1) throw new Error(`this program reads jobs of version 1, but the job has version ${jobs}`);
    const held = resources.map((resource) => hold(device, resource));
    const encoder = device.createCommandEncoder();
    if (work.frame) {
        const { words, textures } = await draw(device, encoder, work.frame, held);
        const done = [await read(device, encoder, [words])].flat();
        [...textures, words].forEach((one) => one.destroy());
        held.forEach((one) => (one.buffer ?? one.texture)?.destroy());
        return { done };
    }
    for (const [number, pass] of work.passes.entries()) {
        const pipeline = await pipelineOf(device, pass, number);
        const dispatch = encoder.beginComputePass();
        dispatch.setPipeline(pipeline);
        bind(device, pipeline, dispatch, pass.bindings, held);
        dispatch.dispatchWorkgroups(...pass.workgroups);
        dispatch.end();
    }
    const buffers = outputs.map((number) => held[number].buffer ?? told(device, encoder, held[number]));
    const done = await read(device, encoder, buffers);
    held.forEach((one) => (one.buffer ?? one.texture)?.destroy());
    return { done };
}

// Submits the work, and returns the contents of some buffers afterwards.
async function read(device, encoder, buffers) {
    const staged = buffers.map((buffer) => {
        const usage = GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST;
        const staging = device.createBuffer({ size: buffer.size, usage });
        encoder.copyBufferToBuffer(buffer, 0, staging, 0, buffer.size);
        return staging;
    });
    device.queue.submit([encoder.finish()]);
    const done = [];
    for (const staging of staged) {
        await staging.mapAsync(GPUMapMode.READ);
        done.push(packed(new Uint8Array(staging.getMappedRange())));
        staging.destroy();
    }
    return done;
}

// Records the draws of a frame, one after another, and returns the image: four 32-bit words for each pixel.
async function draw(device, encoder, frame, held) {
    const { width, height, samples, clear, result } = frame;
    // If the fragment function decides the depth, the pre-pass must run it, too.
    const decides = frame.prepass && (/\bdiscard\b|frag_depth/.test(frame.shader.wgsl) || frame.draws.some(({ draw: one }) => one.depth_fragment));
    if (decides) throw refusal('this program runs no fragment functions in the depth pre-pass', 0);
    if (result === 'depth' && samples > 1) throw refusal('this program reads no depth images with several samples', 0);
    const module = await compiled(device, frame.shader.wgsl, 0);
    const blending = (state, target) => state.blends.findLast(([own]) => own === target)?.[1] ?? state.blend ?? frame.blend;
    const wide = samples === 1 && (device.features.has('float32-blendable')
        || frame.draws.every(({ draw: { state } }) => frame.formats.every((_, target) => blending(state, target) === 'replace')));
    const formats = frame.formats.map((format) => (format === 'float' ? (wide ? 'rgba32float' : 'rgba16float') : format));
    const texture = (format, sampleCount) => device.createTexture({
        size: [width, height],
        format,
        sampleCount,
        usage: GPUTextureUsage.RENDER_ATTACHMENT | (sampleCount === 1 ? GPUTextureUsage.TEXTURE_BINDING : 0),
    });
    const colours = formats.map((format) => texture(format, samples));
    const resolved = samples > 1 ? formats.map((format) => texture(format, 1)) : colours;
    const hasStencil = frame.draws.some(({ draw: { state } }) => state.stencil);
    const depthFormat = hasStencil ? 'depth32float-stencil8' : 'depth32float';
    if (hasStencil && !device.features.has('depth32float-stencil8')) throw refusal('the adapter has no stencil format', 0);
    const depth = texture(depthFormat, samples);
    const writesDepth = frame.shader.wgsl.includes('frag_depth');
    // Uses a render pass for each draw, because a depth-only draw has no colours.
    const targetsOf = (hasColours, loadOp) => encoder.beginRenderPass({
        colorAttachments: hasColours ? colours.map((colour, target) => ({
            view: colour.createView(),
            resolveTarget: samples > 1 ? resolved[target].createView() : undefined,
            loadOp,
            clearValue: clear,
            storeOp: 'store',
        })) : [],
        depthStencilAttachment: {
            view: depth.createView(),
            depthLoadOp: loadOp,
            depthClearValue: frame.clear_depth,
            depthStoreOp: 'store',
            ...(hasStencil ? { stencilLoadOp: loadOp, stencilClearValue: 0, stencilStoreOp: 'store' } : {}),
        },
    });
    targetsOf(true, 'clear').end();
    const inAdvance = frame.draws.filter(({ draw: { geometry } }) => frame.prepass && geometry.mesh).map((own) => ({ ...own, depthAlone: true }));
    for (const { draw: one, covering, bindings, depthAlone = false } of [...inAdvance, ...frame.draws]) {
        const { state, geometry } = one;
        const mesh = geometry.mesh;
        const constants = frame.shader.overrides;
        const buffers = attributes(device, mesh);
        const vertex = covering
            ? { module: await compiled(device, covering, 0), buffers: [] }
            : { module, entryPoint: one.vertex, constants, buffers: buffers.map(({ layout }) => layout) };
        const targets = formats.map((format, target) => ({
            format,
            blend: blend(blending(state, target)),
            writeMask: depthAlone ? 0 : mask(state.masks.findLast(([own]) => own === target)?.[1]),
        }));
        const fragment = one.fragment ? { module, entryPoint: one.fragment, constants, targets } : undefined;
        const face = state.stencil && !depthAlone && {
            compare: state.stencil.compare,
            failOp: state.stencil.fail,
            depthFailOp: state.stencil.depth_fail,
            passOp: state.stencil.pass,
        };
        const pipeline = await device.createRenderPipelineAsync({
            layout: 'auto',
            vertex,
            fragment,
            primitive: { cullMode: state.cull ?? (mesh ? 'back' : 'none'), frontFace: state.winding },
            multisample: { count: samples },
            depthStencil: {
                format: depthFormat,
                ...depthOf(state, frame.prepass && mesh, depthAlone, one.vertex !== null || writesDepth),
                depthBias: state.bias.constant,
                depthBiasSlopeScale: state.bias.slope,
                depthBiasClamp: state.bias.clamp,
                ...(face ? {
                    stencilFront: face,
                    stencilBack: face,
                    stencilReadMask: state.stencil.read_mask,
                    stencilWriteMask: state.stencil.write_mask,
                } : {}),
            },
        }).catch((error) => { throw refusal(error.message, 0); });
        const pass = targetsOf(fragment, 'load');
        pass.setPipeline(pipeline);
        bind(device, pipeline, pass, bindings, held);
        const [cr, cg, cb, ca] = state.blend_constant;
        pass.setBlendConstant({ r: cr, g: cg, b: cb, a: ca });
        if (state.stencil) pass.setStencilReference(state.stencil.reference);
        buffers.forEach(({ buffer }, slot) => pass.setVertexBuffer(slot, buffer));
        if (mesh?.indices.length) {
            const indices = made(device, new Uint32Array(mesh.indices), GPUBufferUsage.INDEX);
            pass.setIndexBuffer(indices, 'uint32');
            pass.drawIndexed(mesh.indices.length, one.instances, 0, one.base_vertex, one.first_instance);
        } else {
            const own = mesh && mesh.attributes.find(({ by_instance: by }) => !by);
            const count = own ? own.words.length / own.width : geometry.vertices ?? 0;
            pass.draw(count, one.instances, 0, one.first_instance);
        }
        pass.end();
    }
    const target = result === 'depth' ? depth : resolved[result.target];
    const words = told(device, encoder, { texture: target, aspect: result === 'depth' ? 'depth-only' : 'all' });
    const textures = [...new Set([...colours, ...resolved, depth])];
    return { words, textures };
}

// The state of the depth test. `isBehind` is set for draws after the pre-pass, and `depthAlone` for the pre-pass
// itself.
function depthOf(state, isBehind, depthAlone, writes) {
    if (isBehind && !depthAlone) return { depthCompare: 'equal', depthWriteEnabled: false };
    const depthCompare = state.depth_compare ?? (depthAlone ? 'less' : 'less-equal');
    return { depthCompare, depthWriteEnabled: state.depth_write ?? writes };
}

// Encodes bytes as base64. Node has `Buffer`, but older browsers have no function for it.
function packed(bytes) {
    if (globalThis.Buffer) return Buffer.from(bytes.buffer, bytes.byteOffset, bytes.byteLength).toString('base64');
    if (bytes.toBase64) return bytes.toBase64();
    let text = '';
    // A call accepts only some ten thousand arguments.
    for (let at = 0; at < bytes.length; at += 0x8000) text += String.fromCharCode(...bytes.subarray(at, at + 0x8000));
    return btoa(text);
}

// Decodes base64 into 32-bit words.
function unpacked(text) {
    if (globalThis.Buffer) return new Uint32Array(new Uint8Array(Buffer.from(text, 'base64')).buffer);
    if (Uint8Array.fromBase64) return new Uint32Array(Uint8Array.fromBase64(text).buffer);
    return new Uint32Array(Uint8Array.from(atob(text), (byte) => byte.charCodeAt(0)).buffer);
}

// The WGSL scalar type of a format's texels.
function scalarOf(format) {
    return /uint$/.test(format) ? 'u32' : /sint$/.test(format) ? 'i32' : 'f32';
}

// For a texture: the end of its type's name in WGSL, and the coordinates of the texel `at` in the first level. Texels
// are counted row by row, and slice by slice.
function placeOf({ dimension = '2d', arrayed = false }) {
    const [x, y, z] = ['at % size.x', 'at / size.x % size.y', 'at / (size.x * size.y)'];
    if (dimension === '1d') return ['1d', 'at'];
    if (dimension === '3d') return ['3d', `vec3u(${x}, ${y}, ${z})`];
    return arrayed || dimension === 'cube' ? ['2d_array', `vec2u(${x}, ${y}), ${z}`] : ['2d', `vec2u(${x}, ${y})`];
}

// Runs a WGSL statement for each texel of a texture's first level.
function perTexel(device, encoder, texture, { declarations, statement, words, view }) {
    const { width, height, depthOrArrayLayers } = texture;
    const texels = width * height * depthOrArrayLayers;
    const code = `${declarations}
        @compute @workgroup_size(64) fn each(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) all: vec3u) {
            let size = vec3u(${width}, ${height}, ${depthOrArrayLayers});
            for (var at = id.x; at < ${texels}u; at += all.x * 64u) { ${statement} }
        }`;
    const module = device.createShaderModule({ code });
    const pipeline = device.createComputePipeline({ layout: 'auto', compute: { module } });
    const entries = [{ binding: 0, resource: texture.createView(view) }, { binding: 1, resource: { buffer: words } }];
    const pass = encoder.beginComputePass();
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries }));
    pass.dispatchWorkgroups(Math.min(Math.ceil(texels / 64), 65535));
    pass.end();
}

// Copies the texels of a texture into a buffer, with four 32-bit words for each texel.
function told(device, encoder, { texture, aspect = 'all', kind = {} }) {
    const { width, height, depthOrArrayLayers, format } = texture;
    const size = 16 * width * height * depthOrArrayLayers;
    const words = device.createBuffer({ size, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_SRC });
    const [end, place] = placeOf(kind);
    const isDepth = aspect === 'depth-only';
    const type = isDepth ? 'texture_depth_2d' : `texture_${end}<${scalarOf(format)}>`;
    const value = isDepth ? `vec4f(textureLoad(image, ${place}, 0), 0.0, 0.0, 1.0)` : `textureLoad(image, ${place}, 0)`;
    perTexel(device, encoder, texture, {
        declarations: `@group(0) @binding(0) var image: ${type};
            @group(0) @binding(1) var<storage, read_write> words: array<vec4u>;`,
        statement: `words[at] = bitcast<vec4u>(${value});`,
        words,
        view: { aspect, dimension: end.replace('_', '-'), mipLevelCount: 1 },
    });
    return words;
}

// Throws a refusal for integers and depths that a format can't store.
function expectHeld(format, levels) {
    const texels = levels.flatMap(({ words }) => words);
    if (format === 'depth32float') {
        const depths = new Float32Array(new Uint32Array(texels.map(([depth]) => depth)).buffer);
        const wrong = depths.find((depth) => !(depth >= 0 && depth <= 1));
        if (wrong !== undefined) throw refusal(`a texel has the depth ${wrong}, but depths must be from 0 to 1`, 0);
    }
    const [, channels, bits, kind] = format.match(/^(r|rg|rgba)(8|16|32)(u|s)int$/) ?? [];
    if (!kind) return;
    const [least, most] = kind === 'u' ? [0, 2 ** bits - 1] : [-(2 ** (bits - 1)), 2 ** (bits - 1) - 1];
    const values = texels.flatMap((texel) => texel.slice(0, channels.length)).map((word) => (kind === 'u' ? word >>> 0 : word | 0));
    const wrong = values.find((value) => value < least || value > most);
    if (wrong !== undefined) throw refusal(`a texel has the value ${wrong}, which the format ${format} can't store`, 0);
}

// Makes a storage texture with texels. A shader writes the texels, because only the device knows the format's layout.
function stored(device, format, kind, [level]) {
    expectHeld(format, [level]);
    const texels = level.words.length / (level.width * level.height);
    const texture = device.createTexture({
        size: [level.width, level.height, texels],
        dimension: kind.dimension,
        format,
        usage: GPUTextureUsage.STORAGE_BINDING | GPUTextureUsage.TEXTURE_BINDING,
    });
    const [end, place] = placeOf(kind);
    const encoder = device.createCommandEncoder();
    perTexel(device, encoder, texture, {
        declarations: `@group(0) @binding(0) var image: texture_storage_${end}<${format}, write>;
            @group(0) @binding(1) var<storage, read> words: array<vec4u>;`,
        statement: `textureStore(image, ${place}, bitcast<vec4<${scalarOf(format)}>>(words[at]));`,
        words: made(device, new Uint32Array(level.words.flat()), GPUBufferUsage.STORAGE),
        view: { dimension: end.replace('_', '-') },
    });
    device.queue.submit([encoder.finish()]);
    return texture;
}

// Makes a depth texture, or a texture with several samples a texel. Only draws can fill such a texture. The samples of
// one texel are next to each other in `words`.
function painted(device, texels, samples, levels) {
    const isDepth = texels === 'depth';
    const [{ width, height, words }] = levels;
    const layers = words.length / (width * height * samples);
    const format = isDepth ? 'depth32float' : { float: 'rgba16float', sint: 'rgba16sint', uint: 'rgba16uint' }[texels];
    expectHeld(format, levels);
    const texture = device.createTexture({
        size: [width, height, layers],
        mipLevelCount: levels.length,
        sampleCount: samples,
        format,
        usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.RENDER_ATTACHMENT,
    });
    const scalar = isDepth ? 'f32' : scalarOf(texture.format);
    const [result, value] = isDepth ? ['@builtin(frag_depth) f32', '.x'] : [`@location(0) vec4<${scalar}>`, ''];
    const [sample, index] = samples > 1 ? [', @builtin(sample_index) s: u32', 's'] : ['', '0u'];
    const encoder = device.createCommandEncoder();
    levels.forEach((level, baseMipLevel) => {
        const code = `@group(0) @binding(0) var<storage, read> texels: array<vec4<${scalar}>>;
            @vertex fn vertex(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
                return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
            }
            @fragment fn fragment(@builtin(position) p: vec4f${sample}) -> ${result} {
                return texels[(u32(p.y) * ${level.width}u + u32(p.x)) * ${samples}u + ${index}]${value};
            }`;
        const module = device.createShaderModule({ code });
        const pipeline = device.createRenderPipeline({
            layout: 'auto',
            vertex: { module },
            fragment: { module, targets: isDepth ? [] : [{ format: texture.format }] },
            depthStencil: isDepth ? { format: texture.format, depthWriteEnabled: true, depthCompare: 'always' } : undefined,
            multisample: { count: samples },
        });
        const each = level.words.length / layers;
        for (let baseArrayLayer = 0; baseArrayLayer < layers; baseArrayLayer++) {
            const own = level.words.slice(baseArrayLayer * each, (baseArrayLayer + 1) * each);
            const buffer = made(device, new Uint32Array(own.flat()), GPUBufferUsage.STORAGE);
            const view = texture.createView({ dimension: '2d', baseMipLevel, mipLevelCount: 1, baseArrayLayer, arrayLayerCount: 1 });
            const pass = encoder.beginRenderPass({
                colorAttachments: isDepth ? [] : [{ view, loadOp: 'clear', storeOp: 'store' }],
                depthStencilAttachment: isDepth ? { view, depthLoadOp: 'clear', depthClearValue: 0, depthStoreOp: 'store' } : undefined,
            });
            pass.setPipeline(pipeline);
            const entries = [{ binding: 0, resource: { buffer } }];
            pass.setBindGroup(0, device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries }));
            pass.draw(3);
            pass.end();
        }
    });
    device.queue.submit([encoder.finish()]);
    return texture;
}

// The vertex buffers of a mesh, one for each attribute.
function attributes(device, mesh) {
    const names = { f32: 'float32', i32: 'sint32', u32: 'uint32' };
    return (mesh?.attributes ?? []).map(({ location, scalar, width, words, by_instance: byInstance }) => {
        if (!names[scalar]) throw refusal(`this program supports no vertex attributes of type ${scalar}`, 0);
        const format = width > 1 ? `${names[scalar]}x${width}` : names[scalar];
        const layout = {
            arrayStride: 4 * width,
            stepMode: byInstance ? 'instance' : 'vertex',
            attributes: [{ format, offset: 0, shaderLocation: location }],
        };
        return { layout, buffer: made(device, new Uint32Array(words), GPUBufferUsage.VERTEX) };
    });
}

function made(device, words, usage) {
    const buffer = device.createBuffer({ size: Math.max(words.byteLength, 4), usage: usage | GPUBufferUsage.COPY_DST });
    device.queue.writeBuffer(buffer, 0, words);
    return buffer;
}

// Returns the formula that combines a new value with a pixel's old value.
function blend(kind) {
    const component = (srcFactor, dstFactor, operation = 'add') => ({ srcFactor, dstFactor, operation });
    const both = (color, alpha = color) => ({ color, alpha });
    if (kind.custom) {
        const own = ({ src_factor: src, dst_factor: dst, operation }) => component(src, dst, operation);
        return both(own(kind.custom.color), own(kind.custom.alpha));
    }
    return {
        replace: undefined,
        add: both(component('one', 'one')),
        alpha: both(component('src-alpha', 'one-minus-src-alpha'), component('one', 'one-minus-src-alpha')),
        premultiplied: both(component('one', 'one-minus-src-alpha')),
        multiply: both(component('dst', 'zero')),
    }[kind];
}

function mask(channels) {
    const bits = { r: 1, g: 2, b: 4, a: 8 };
    return channels === undefined ? 15 : [...channels].reduce((sum, channel) => sum | bits[channel], 0);
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
        const words = typeof buffer.words === 'string' ? unpacked(buffer.words) : new Uint32Array(buffer.words);
        const { STORAGE, UNIFORM, COPY_SRC, COPY_DST } = GPUBufferUsage;
        const usage = STORAGE | UNIFORM | COPY_SRC | COPY_DST;
        const made = device.createBuffer({ size: Math.max(words.byteLength, 4), usage });
        device.queue.writeBuffer(made, 0, words);
        return { buffer: made };
    }
    const { dimension, arrayed, texels, samples, levels } = texture.texture;
    const kind = { dimension, arrayed };
    const view = { dimension: arrayed ? `${dimension}-array` : dimension };
    if (texture.format) return { texture: stored(device, texture.format, kind, levels), view, kind };
    if (texels === 'depth' || samples > 1) return { texture: painted(device, texels, samples, levels), view, kind };
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
    return { texture: made, view, kind };
}
