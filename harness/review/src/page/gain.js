// The gain of the difference view. Until you choose a gain, it depends on the shown frame, so that no gain stays from
// the previous frame. The scale ends at a power of two above 99 % of the differences: otherwise a few highlights would
// darken all other pixels. Values beyond the scale are pale.

const gain = (() => {
  const LEAST = 149; // the smallest f32 is this many stops below 1
  const channels = (channel) => (channel === 0 ? [0, 1, 2] : channel === 5 ? null : [channel - 1]);

  // Returns the gain in stops at which 99 % of the differences are within the scale. Differences are counted by powers
  // of two.
  const automatic = ({ golden, actual }, { relative, channel, exposure }) => {
    const counts = new Uint32Array(LEAST + 130);
    const alpha = channel === 4;
    const light = relative || alpha ? 1 : 2 ** exposure;
    const dark = alpha ? 0.01 : golden.dark;
    const chosen = channels(channel);
    const [width, height] = [Math.min(golden.width, actual.width), Math.min(golden.height, actual.height)];
    let total = 0;
    const count = (g, a) => {
      const size = (Math.abs(a - g) * light) / (relative ? Math.max(Math.abs(g), dark) : 1);
      if (!(size > 0 && size < Infinity)) return;
      counts[Math.min(counts.length - 1, Math.max(0, Math.ceil(Math.log2(size)) + LEAST))] += 1;
      total += 1;
    };
    for (let y = 0; y < height; y += 1) {
      for (let x = 0; x < width; x += 1) {
        const [i, j] = [4 * (y * golden.width + x), 4 * (y * actual.width + x)];
        if (chosen) for (const c of chosen) count(golden.values[i + c], actual.values[j + c]);
        else count(tones.luminance(golden.values.subarray(i, i + 3)), tones.luminance(actual.values.subarray(j, j + 3)));
      }
    }
    if (!total) return 0;
    let rest = Math.floor(0.99 * total);
    const power = counts.findIndex((number) => { rest -= number; return rest < 0; });
    return LEAST - power;
  };

  // Computes the gain again only if an input changes.
  let known = { part: null, key: "", stops: 0 };
  listeners.push(() => {
    const shown = part();
    if (!state.gainAuto || state.view !== "difference" || !shown?.golden || !shown?.actual) return;
    const key = `${state.relative} ${state.channel} ${state.relative ? 0 : state.exposure}`;
    if (known.part !== shown || known.key !== key) known = { part: shown, key, stops: automatic(shown, state) };
    state.gain = known.stops;
  });

  const by = (stops) => change({ gain: state.gain + stops, gainAuto: false });
  const text = () => (state.gain < 0 ? `1/${2 ** -state.gain}` : `× ${2 ** state.gain}`);
  return { automatic, by, text };
})();
