// The stored numbers: halves, the order of f32, shortest digits. This script has no state.

const numbers = (() => {
  const float = new Float32Array(1);
  const bits = new Uint32Array(float.buffer);

  // Decodes base64 into bytes.
  const bytes = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0));

  // Converts an IEC 60559 binary16 to a number. Each half is exact.
  const half = (word) => {
    const sign = word & 0x8000 ? -1 : 1;
    const exponent = (word >> 10) & 31;
    const fraction = word & 1023;
    if (exponent === 31) return fraction ? NaN : sign * Infinity;
    if (exponent === 0) return sign * fraction * 2 ** -24;
    return sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
  };

  // A table of all halves by their bits. A frame has few distinct halves, and a table is the fastest way.
  const halves = Float32Array.from({ length: 65536 }, (_, word) => half(word));

  // Returns the floats of one side of a part, four per pixel. They are little-endian on any machine.
  const decode = ({ format, data }) => {
    const view = new DataView(bytes(data).buffer);
    const size = format === "f16" ? 2 : 4;
    const values = new Float32Array(view.byteLength / size);
    for (let i = 0; i < values.length; i += 1) {
      values[i] = size === 2 ? halves[view.getUint16(2 * i, true)] : view.getFloat32(4 * i, true);
    }
    return values;
  };

  // Returns an image that `packed.rs` has stored: four floats per pixel, and its words, with one plane per channel. A
  // frame is stored as differences from `golden`, the words of its golden.
  const unpacked = ({ width, height, format, packed: { channels, of_golden: ofGolden } }, stored, golden) => {
    const count = width * height;
    const size = format === "f16" ? 2 : 4;
    const values = new Float32Array(4 * count);
    const floats = new Uint32Array(values.buffer);
    const words = size === 2 ? new Uint16Array(channels * count) : new Uint32Array(channels * count);
    for (let c = 0; c < channels; c += 1) {
      const start = c * size * count;
      let before = 0;
      for (let i = 0; i < count; i += 1) {
        let word = 0;
        for (let byte = 0; byte < size; byte += 1) word = (word << 8) | stored[start + byte * count + i];
        const distance = (word >>> 1) ^ -(word & 1);
        words[c * count + i] = (ofGolden ? golden[c * count + i] : before) + distance; // wraps at 2^16 or 2^32
        before = words[c * count + i];
        if (size === 2) values[4 * i + c] = halves[before];
        else floats[4 * i + c] = before;
      }
    }
    if (channels === 1) { // a map; a hole is NaN
      for (let i = 0; i < values.length; i += 4) {
        const hole = Number.isNaN(values[i]);
        values.fill(hole ? 0 : values[i], i, i + 3);
        values[i + 3] = hole ? 0 : 1;
      }
    }
    return { values, words };
  };

  const inflated = async (text) => {
    if (typeof DecompressionStream === "undefined") {
      throw new Error("This browser can't inflate the frame: take a current Firefox, Chrome, Edge or Safari.");
    }
    const stream = new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  };

  // Unpacks the sides of a part, or a map. Images from other sources aren't packed.
  const image = async (stored, golden = null) => {
    const { width, height } = stored;
    if (!stored.packed) return { width, height, values: decode(stored) };
    return { width, height, ...unpacked(stored, await inflated(stored.data), golden?.words) };
  };

  // Returns the position of a value in the order of f32. Both zeros have the position 0.
  const ordinal = (value) => {
    float[0] = value;
    const magnitude = bits[0] & 0x7fffffff;
    return bits[0] >>> 31 ? -magnitude : magnitude;
  };

  // Returns the number of f32 steps between two values, or null if one of them is NaN.
  const ulps = (a, b) =>
    Number.isNaN(a) || Number.isNaN(b) ? null : Math.abs(ordinal(a) - ordinal(b));

  // Returns the shortest digits that read back as the same f32, in Rust's format: with an exponent if plain digits
  // would be long.
  const shortest = (value) => {
    if (Number.isNaN(value)) return "NaN";
    if (!Number.isFinite(value)) return value > 0 ? "inf" : "-inf";
    if (value === 0) return Object.is(value, -0) ? "-0" : "0";
    let text = "";
    for (let digits = 1; digits <= 9 && !text; digits += 1) text = reading(value, digits); // 9 suffice
    const size = Math.abs(value);
    return size >= Math.fround(1e-4) && size < 1e7 ? plain(text) : text;
  };

  // Returns digits that read back as the same f32, or nothing. The nearest decimal may not read back: below a power of
  // two, the f32 are closer, and only the decimal above may read back.
  const reading = (value, digits) => {
    const nearest = value.toExponential(digits - 1).replace("e+", "e");
    const [mantissa, exponent] = nearest.split("e");
    const whole = Number(mantissa.replace(".", ""));
    const away = `${whole + Math.sign(value)}e${Number(exponent) - digits + 1}`;
    const reads = [nearest, away].find((text) => Math.fround(Number(text)) === value);
    return reads === away ? Number(away).toExponential(digits - 1).replace("e+", "e") : reads ?? "";
  };

  // Formats `1.25e-2` without its exponent.
  const plain = (text) => {
    const [, sign, first, rest = "", exponent] = text.match(/^(-?)(\d)(?:\.(\d+))?e(-?\d+)$/);
    const digits = first + rest;
    const point = 1 + Number(exponent);
    if (point <= 0) return `${sign}0.${"0".repeat(-point)}${digits}`;
    if (point >= digits.length) return sign + digits + "0".repeat(point - digits.length);
    return `${sign}${digits.slice(0, point)}.${digits.slice(point)}`;
  };

  // Formats a derived number for reading: three digits, with its sign if `signed` is set.
  const rounded = (value, signed = false) => {
    if (value === null || Number.isNaN(value)) return value === null ? "–" : "NaN";
    const size = Math.abs(value);
    if (size === 0) return "0";
    const sign = value < 0 ? "−" : signed ? "+" : "";
    if (size === Infinity) return `${sign}inf`;
    if (size >= 1e-3 && size < 1e4) return sign + String(Number(size.toPrecision(3)));
    return sign + Number(size.toPrecision(3)).toExponential().replace("e+", "e").replace("e-", "e−");
  };

  return { half, decode, image, ulps, shortest, rounded };
})();
