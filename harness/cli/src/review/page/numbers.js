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

  // The floats of a side of a part, four a pixel; little-endian whatever this machine is.
  const decode = ({ format, data }) => {
    const view = new DataView(bytes(data).buffer);
    const size = format === "f16" ? 2 : 4;
    const values = new Float32Array(view.byteLength / size);
    for (let i = 0; i < values.length; i += 1) {
      values[i] = size === 2 ? halves[view.getUint16(2 * i, true)] : view.getFloat32(4 * i, true);
    }
    return values;
  };

  // Place on the ordered line of f32, where both zeros are 0.
  const ordinal = (value) => {
    float[0] = value;
    const magnitude = bits[0] & 0x7fffffff;
    return bits[0] >>> 31 ? -magnitude : magnitude;
  };

  // How many f32 lie between two; null if one is NaN.
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

  // Digits that read back as the same f32, or nothing. The nearest decimal need not: below a power
  // of two the f32 are closer, so that its neighbour above may do.
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

  return { half, decode, ulps, shortest, rounded };
})();
