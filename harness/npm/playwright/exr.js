// @ts-check

/**
 * Returns an OpenEXR file of floats: scan lines of red, green, blue and alpha, without compression. The layout is
 * described in "OpenEXR File Layout" (openexr.com).
 * @param {number} width
 * @param {number} height
 * @param {Float32Array} pixels Four floats for each pixel, row by row from the upper left.
 */
export function exr(width, height, pixels) {
  /** @type {Uint8Array[]} */
  const parts = [];
  const text = (/** @type {string} */ value) => Buffer.from(`${value}\0`, "latin1");
  const int = (/** @type {number} */ value) => {
    const bytes = Buffer.alloc(4);
    bytes.writeInt32LE(value);
    return bytes;
  };
  const float = (/** @type {number} */ value) => {
    const bytes = Buffer.alloc(4);
    bytes.writeFloatLE(value);
    return bytes;
  };
  const attribute = (/** @type {string} */ name, /** @type {string} */ type, /** @type {Uint8Array[]} */ ...values) => {
    const value = Buffer.concat(values);
    parts.push(text(name), text(type), int(value.length), value);
  };
  parts.push(int(20000630), int(2)); // its magic number and version
  // Channels are in alphabetical order. 2 means float, and each pixel has one sample.
  const channels = ["A", "B", "G", "R"];
  const channel = (/** @type {string} */ name) => Buffer.concat([text(name), int(2), int(0), int(1), int(1)]);
  attribute("channels", "chlist", ...channels.map(channel), Buffer.from([0]));
  attribute("compression", "compression", Buffer.from([0]));
  const box = [0, 0, width - 1, height - 1].map(int);
  attribute("dataWindow", "box2i", ...box);
  attribute("displayWindow", "box2i", ...box);
  attribute("lineOrder", "lineOrder", Buffer.from([0]));
  attribute("pixelAspectRatio", "float", float(1));
  attribute("screenWindowCenter", "v2f", float(0), float(0));
  attribute("screenWindowWidth", "float", float(1));
  parts.push(Buffer.from([0]));
  const start = parts.reduce((sum, part) => sum + part.length, 0);
  const line = 4 * channels.length * width;
  const offsets = Buffer.alloc(8 * height);
  for (let y = 0; y < height; y++) offsets.writeBigUInt64LE(BigInt(start + offsets.length + y * (8 + line)), 8 * y);
  parts.push(offsets);
  for (let y = 0; y < height; y++) {
    const samples = Buffer.alloc(line);
    for (const [at, component] of [3, 2, 1, 0].entries()) {
      for (let x = 0; x < width; x++) samples.writeFloatLE(pixels[4 * (y * width + x) + component], 4 * (at * width + x));
    }
    parts.push(int(y), int(line), samples);
  }
  return Buffer.concat(parts);
}
