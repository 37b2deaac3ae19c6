// Numbers as they are stored: halves, the ordered line of f32, shortest digits. No state.

const numbers = (() => {
  const float = new Float32Array(1);
  const bits = new Uint32Array(float.buffer);

  // Bytes of base64.
  const bytes = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0));

  // IEC 60559 binary16 to a number. Each half is exact.
  const half = (word) => {
    const sign = word & 0x8000 ? -1 : 1;
    const exponent = (word >> 10) & 31;
    const fraction = word & 1023;
    if (exponent === 31) return fraction ? NaN : sign * Infinity;
    if (exponent === 0) return sign * fraction * 2 ** -24;
    return sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
  };

  // All halves by their bits: a frame has few distinct ones, and this is the fastest way.
  const halves = Float32Array.from({ length: 65536 }, (_, word) => half(word));

  // The floats of a side of a part, four a pixel; little-endian on any machine.
  const decode = ({ format, data }) => {
    const view = new DataView(bytes(data).buffer);
    const size = format === "f16" ? 2 : 4;
    const values = new Float32Array(view.byteLength / size);
    for (let i = 0; i < values.length; i += 1) {
      values[i] = size === 2 ? halves[view.getUint16(2 * i, true)] : view.getFloat32(4 * i, true);
    }
    return values;
  };

  // An image as `packed.rs` has stored it: four floats a pixel, and its words, a plane for each channel. A frame is
  // stored as differences from `golden`, the words of its golden.
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
        words[c * count + i] = (ofGolden ? golden[c * count + i] : before) + distance; // wraps
        before = words[c * count + i];
        if (size === 2) values[4 * i + c] = halves[before];
        else floats[4 * i + c] = before;
      }
    }
    if (channels === 1) { // a map; a hole is no number
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

  // A part's sides, or a map. Images from other sources aren't packed.
  const image = async (stored, golden = null) => {
    const { width, height } = stored;
    if (!stored.packed) return { width, height, values: decode(stored) };
    return { width, height, ...unpacked(stored, await inflated(stored.data), golden?.words) };
  };

  // Place on the ordered line of f32, where both zeros are 0.
  const ordinal = (value) => {
    float[0] = value;
    const magnitude = bits[0] & 0x7fffffff;
    return bits[0] >>> 31 ? -magnitude : magnitude;
  };

  // The number of f32 steps between two values; null if one is NaN.
  const ulps = (a, b) =>
    Number.isNaN(a) || Number.isNaN(b) ? null : Math.abs(ordinal(a) - ordinal(b));

  // The shortest digits that read back as the same f32, as Rust prints them: with an exponent where
  // plain digits would be long.
  const shortest = (value) => {
    if (Number.isNaN(value)) return "NaN";
    if (!Number.isFinite(value)) return value > 0 ? "inf" : "-inf";
    if (value === 0) return Object.is(value, -0) ? "-0" : "0";
    let text = "";
    for (let digits = 1; digits <= 9 && !text; digits += 1) text = reading(value, digits); // 9 suffice
    const size = Math.abs(value);
    return size >= Math.fround(1e-4) && size < 1e7 ? plain(text) : text;
  };

  // Digits that read back as the same f32, or nothing. The nearest decimal may not: below a power of two the f32 are
  // closer, and only the decimal above may do so.
  const reading = (value, digits) => {
    const nearest = value.toExponential(digits - 1).replace("e+", "e");
    const [mantissa, exponent] = nearest.split("e");
    const whole = Number(mantissa.replace(".", ""));
    const away = `${whole + Math.sign(value)}e${Number(exponent) - digits + 1}`;
    const reads = [nearest, away].find((text) => Math.fround(Number(text)) === value);
    return reads === away ? Number(away).toExponential(digits - 1).replace("e+", "e") : reads ?? "";
  };

  // `1.25e-2` without its exponent.
  const plain = (text) => {
    const [, sign, first, rest = "", exponent] = text.match(/^(-?)(\d)(?:\.(\d+))?e(-?\d+)$/);
    const digits = first + rest;
    const point = 1 + Number(exponent);
    if (point <= 0) return `${sign}0.${"0".repeat(-point)}${digits}`;
    if (point >= digits.length) return sign + digits + "0".repeat(point - digits.length);
    return `${sign}${digits.slice(0, point)}.${digits.slice(point)}`;
  };

  // A derived number, for reading: three digits, with its sign if `signed`.
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
