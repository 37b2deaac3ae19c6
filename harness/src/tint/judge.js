// Asks Tint about one text: in Node through Dawn, and in a page through the browser. Rust code chooses the texts, and
// uses the answers.
const devices = new Map();
// Makes a device with all features of its adapter, because the project decides which features a text may use. The
// device has WebGPU's default limits, because Karat checks limits with naga's IR.
async function deviceOf(gpu, compatibility) {
  if (!devices.has(compatibility)) {
    const adapter = await gpu.requestAdapter(compatibility ? { featureLevel: 'compatibility' } : {});
    if (!adapter) throw new Error('WebGPU has no adapter here');
    // A device with this feature wouldn't be in compatibility mode.
    const features = [...adapter.features].filter((name) => !compatibility || name !== 'core-features-and-limits');
    devices.set(compatibility, await adapter.requestDevice({ requiredFeatures: features }));
  }
  return devices.get(compatibility);
}
// FNV-1a over UTF-16 code units, as `sum` in answer.rs.
function sum(text) {
  let sum = 0x811c9dc5;
  for (let i = 0; i < text.length; i++) sum = Math.imul(sum ^ text.charCodeAt(i), 0x01000193) >>> 0;
  return sum;
}
// Runs `work`. Returns its result with the first validation error, or null.
async function scoped(device, work) {
  device.pushErrorScope('validation');
  let made, thrown = null;
  try { made = await work(); } catch (error) { thrown = error; }
  const error = (await device.popErrorScope()) ?? thrown;
  return { made, error: error ? String(error.message) : null };
}
function descriptor(module, pipeline, feeder) {
  const { entry_point: entryPoint, attributes, targets } = pipeline;
  const stage = { module, entryPoint };
  if (pipeline.stage === 'compute') return { layout: 'auto', compute: stage };
  const depthStencil = { format: 'depth24plus', depthWriteEnabled: true, depthCompare: 'always' };
  const fragment = { ...stage, targets: targets.map((format) => format && { format }) };
  if (feeder) return { layout: 'auto', vertex: { module: feeder, entryPoint: 'karat_feeds' }, fragment, depthStencil };
  // Each attribute gets 16 bytes, which is enough for the widest format.
  const placed = attributes.map((attribute, at) => ({ ...attribute, offset: 16 * at }));
  const buffers = placed.length ? [{ arrayStride: 16 * placed.length, attributes: placed }] : [];
  return { layout: 'auto', vertex: { ...stage, buffers }, depthStencil };
}
async function judge(gpu, question) {
  const device = await deviceOf(gpu, question.compatibility);
  let info;
  const { made: module } = await scoped(device, async () => {
    const module = device.createShaderModule({ code: question.text });
    info = await module.getCompilationInfo();
    return module;
  });
  const messages = info.messages.map((message) => ({
    severity: message.type, text: message.message, offset: message.offset, length: message.length, line: message.lineNum,
  }));
  const pipelines = [];
  if (!messages.some((message) => message.severity === 'error')) {
    for (const pipeline of question.pipelines) {
      let feeder = null;
      if (pipeline.feeder) {
        const made = await scoped(device, () => device.createShaderModule({ code: pipeline.feeder }));
        if (made.error) { pipelines.push({ entry_point: pipeline.entry_point, broke: made.error }); continue; }
        feeder = made.made;
      }
      const { error } = await scoped(device, () => pipeline.stage === 'compute'
        ? device.createComputePipeline(descriptor(module, pipeline))
        : device.createRenderPipeline(descriptor(module, pipeline, feeder)));
      pipelines.push({ entry_point: pipeline.entry_point, error });
    }
  }
  return { id: question.id, sum: sum(question.text), messages, pipelines };
}
