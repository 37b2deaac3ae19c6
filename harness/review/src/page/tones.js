// The conversion from linear light to the colours of a screen. `shader.js` has the same formulas in GLSL; the tests
// compare the canvas with these. Input and output are linear sRGB (BT.709). This script has no state.

const tones = (() => {
  const clamp = (x) => Math.min(1, Math.max(0, x));

  // IEC 61966-2-1, from linear light in 0..=1.
  const encode = (x) => (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);

  const luminance = ([r, g, b]) => 0.2126 * r + 0.7152 * g + 0.0722 * b; // ITU-R BT.709

  // The bounds of the shader: the fits square the value, and infinity divided by infinity isn't white.
  const bounded = (x) => Math.min(1e15, Math.max(0, x));

  const each = (curve) => (rgb) => rgb.map((x) => encode(clamp(curve(bounded(x)))));

  // Multiplies the columns of the matrix by components, in GLSL's order.
  const times = (m, [r, g, b]) =>
    [0, 1, 2].map((row) => m[row] * r + m[row + 3] * g + m[row + 6] * b);

  // Wrensch 2023, "Minimal AgX Implementation": inset matrix, log2 range and the polynomial fit of
  // Sobotka's AgX base contrast; the outset matrix gives display values of exponent 2.2.
  const agxIn = [0.842479062253094, 0.0423282422610123, 0.0423756549057051,
    0.0784335999999992, 0.878468636469772, 0.0784336,
    0.0792237451477643, 0.0791661274605434, 0.879142973793104];
  const agxOut = [1.19687900512017, -0.0528968517574562, -0.0529716355144438,
    -0.0980208811401368, 1.15190312990417, -0.0980434501171241,
    -0.0990297440797205, -0.0989611768448433, 1.15107367264116];
  const agxContrast = (x) =>
    ((((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x - 0.00232);
  const agx = (rgb) => {
    const inset = times(agxIn, rgb.map(bounded));
    const log = inset.map((x) => clamp((Math.log2(Math.max(x, 1e-10)) + 12.47393) / 16.5));
    const display = times(agxOut, log.map(agxContrast)).map(clamp);
    return display.map((x) => clamp(encode(x ** 2.2)));
  };

  // The tone maps in the order of the menu and of the shader's `tone`.
  const all = [
    { name: "sRGB, clipped", map: each((x) => x) },
    // Reinhard et al. 2002, eq. 3, on each channel.
    { name: "Reinhard", map: each((x) => x / (1 + x)) },
    // Narkowicz 2016, "ACES Filmic Tone Mapping Curve".
    { name: "ACES fit", map: each((x) => (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)) },
    { name: "AgX fit", map: agx },
  ];

  // Mikhailov 2019, "Turbo, An Improved Rainbow Colormap", by its polynomial fit.
  const turbo = (t) => {
    const x = clamp(t);
    const poly = (c) => clamp(c.reduceRight((sum, k) => sum * x + k, 0));
    return [
      poly([0.13572138, 4.6153926, -42.66032258, 132.13108234, -152.94239396, 59.28637943]),
      poly([0.09140261, 2.19418839, 4.84296658, -14.18503333, 4.27729857, 2.82956604]),
      poly([0.1066733, 12.64194608, -60.58204836, 110.36276771, -89.90310912, 27.34824973]),
    ];
  };

  // False colour spans this many stops on each side of middle grey.
  const STOPS = 8;
  const falseColor = (light) => turbo((Math.log2(light / 0.18) / STOPS + 1) / 2);

  // Returns the colour of a signed value in -1..=1 or beyond: 0 is black, positive values are orange, negative ones
  // blue. The root brightens small values. Values out of range are pale.
  const signed = (value) => {
    const t = Math.sqrt(clamp(Math.abs(value)));
    const over = Math.abs(value) > 1 ? 0.55 : 0;
    const hue = value > 0 ? [1, 0.5, 0.1] : [0.2, 0.55, 1];
    return hue.map((x) => x * t * (1 - over) + over);
  };

  // A difference of channels, each in -1..=1 or beyond, is shown in one of three ways. In all of them, the root
  // brightens small values.
  const root = (value) => Math.sqrt(clamp(Math.abs(value)));
  const differences = [
    "signed, largest", // orange: the frame is larger; blue: the golden is larger
    "signed by channel", // grey: equal; a larger channel adds its hue, a smaller one subtracts it
    "absolute by channel", // black: equal; each channel has its hue
  ];
  // Returns the colour of a single channel: R, G and B have their hue, and all others are white.
  const HUES = { 1: [1, 0.15, 0.15], 2: [0.15, 1, 0.15], 3: [0.25, 0.35, 1] };
  const byChannel = (rgb, channel) => {
    if (channel === 0) return rgb.map((value) => 0.5 + 0.5 * Math.sign(value) * root(value));
    const hue = HUES[channel] ?? [1, 1, 1];
    const t = 0.5 + 0.5 * Math.sign(rgb[0]) * root(rgb[0]);
    return hue.map((x) => 0.5 + (t - 0.5) * (2 * x - 1)); // its hue or the opposite one
  };
  const absolute = (rgb, channel) => {
    if (channel === 0) return rgb.map(root);
    return (HUES[channel] ?? [1, 1, 1]).map((x) => x * root(rgb[0]));
  };

  return { all, encode, luminance, turbo, falseColor, signed, differences, byChannel, absolute, STOPS };
})();
