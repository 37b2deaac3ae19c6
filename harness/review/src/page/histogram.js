// The number of pixels of each side by value. The horizontal axis shows stops from middle grey. The vertical axis shows
// the number on a logarithmic scale, so that a few highlights are visible beside thousands of pixels.

const histogram = (() => {
  const STOPS = 16; // on each side of middle grey
  const BINS = 128;
  const canvas = byId("histogram").querySelector("canvas");

  // Returns the number of pixels by stops. `none` counts the pixels without a logarithm: zero, negative, NaN.
  const of = (image, channel) => {
    const bins = new Uint32Array(BINS);
    let none = 0;
    const { values } = image;
    for (let i = 0; i < values.length; i += 4) {
      const value = channel >= 1 && channel <= 4 ? values[i + channel - 1]
        : 0.2126 * values[i] + 0.7152 * values[i + 1] + 0.0722 * values[i + 2];
      if (!(value > 0 && value < Infinity)) { none += 1; continue; }
      const bin = Math.floor(((Math.log2(value / 0.18) + STOPS) / (2 * STOPS)) * BINS);
      bins[Math.min(BINS - 1, Math.max(0, bin))] += 1;
    }
    return { bins, none };
  };

  const SIDES = [["golden", "--golden"], ["actual", "--actual"]];
  const draw = (found) => {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(1, Math.round(side * ratio)));
    Object.assign(canvas, { width, height });
    const context = canvas.getContext("2d");
    const most = Math.max(1, ...found.flatMap((side) => (side ? [...side.bins] : [])));
    const style = getComputedStyle(canvas);
    const y = (count) => height - 1 - (height - 3) * (Math.log1p(count) / Math.log1p(most));
    // Draws lines at middle grey, and at each power of ten.
    context.fillStyle = style.getPropertyValue("--line");
    context.fillRect(Math.round(width / 2), 0, 1, height);
    for (let count = 1; count <= most; count *= 10) context.fillRect(0, Math.round(y(count)), width, 1);
    found.forEach((side, at) => {
      if (!side) return;
      context.strokeStyle = style.getPropertyValue(SIDES[at][1]);
      context.lineWidth = ratio * (at ? 1 : 2);
      context.beginPath();
      side.bins.forEach((count, bin) => {
        const [left, right] = [(bin / BINS) * width, ((bin + 1) / BINS) * width];
        context.lineTo(left, y(count));
        context.lineTo(right, y(count));
      });
      context.stroke();
    });
    byId("histogram-most").textContent = `${most} pixels`;
    const none = found.map((side) => side?.none ?? 0);
    byId("histogram-none").textContent = none.some(Boolean) ? `without a logarithm: golden ${none[0]}, actual ${none[1]}` : "";
  };

  let shown = [];
  const update = (force = false) => {
    byId("histogram").hidden = !part();
    if (!part() || !byId("histogram").open) return;
    const now = [part(), state.channel, canvas.clientWidth];
    if (!force && now.every((value, i) => value === shown[i])) return;
    shown = now;
    const channel = state.channel;
    byId("histogram-of").textContent = channel >= 1 && channel <= 4 ? CHANNELS[channel] : "luminance";
    draw([part().golden, part().actual].map((image) => image && of(image, channel)));
  };
  listeners.push(() => update());
  byId("histogram").addEventListener("toggle", () => update(true));
  matchMedia("(prefers-color-scheme: light)").addEventListener("change", () => update(true));

  const toggle = () => {
    byId("histogram").open = !byId("histogram").open;
    if (byId("histogram").open) byId("histogram").scrollIntoView({ block: "nearest" });
  };
  return { of, toggle };
})();
