// The pixels that the test's gate refuses, and their areas: rectangles of neighbours. The test has already judged. This
// script finds the refused pixels again, by the same bounds.

const failing = (() => {
  const CLEAR = 0.01; // a smaller alpha is compared as this alpha, as in the gate
  const MOST = 48; // more rectangles would hide the image, so near ones are joined

  // Returns for each pixel 1 if it differs from the golden by more than the bound. Also returns the worst ratio.
  const refused = ({ golden, actual }, { relative, absolute }, mask) => {
    const { width, height } = golden;
    const floor = absolute ?? relative * golden.dark;
    const clear = absolute ?? relative * CLEAR;
    const out = new Float32Array(width * height);
    for (let i = 0; i < out.length; i += 1) {
      if (mask && !(mask.values[4 * i] > 0.5)) continue;
      let most = 0;
      for (let c = 0; c < 4; c += 1) {
        const [g, a] = [golden.values[4 * i + c], actual.values[4 * i + c]];
        const allowed = Math.max(relative * Math.abs(g), c === 3 ? clear : floor);
        const ratio = g === a ? 0 : Math.abs(a - g) / allowed;
        if (!(ratio <= most)) most = ratio >= 0 ? ratio : Infinity;
        if (!Number.isFinite(a) || !Number.isFinite(g)) most = Infinity;
      }
      if (most > 1) out[i] = most;
    }
    return out;
  };

  // Returns rectangles around refused pixels whose cells of a given size touch, even if only at corners.
  const areas = (ratios, width, height, cell) => {
    const [across, down] = [Math.ceil(width / cell), Math.ceil(height / cell)];
    const cells = new Map(); // the rectangle of each cell with refused pixels
    ratios.forEach((ratio, i) => {
      if (!ratio) return;
      const [x, y] = [i % width, Math.floor(i / width)];
      const key = Math.floor(y / cell) * across + Math.floor(x / cell);
      join(cells, key, { left: x, top: y, right: x, bottom: y, count: 1, ratio, at: [x, y] });
    });
    const found = [];
    for (const start of [...cells.keys()]) {
      if (!cells.has(start)) continue;
      const area = new Map();
      const open = [start];
      while (open.length) {
        const key = open.pop();
        const box = cells.get(key);
        if (!box) continue;
        cells.delete(key);
        join(area, 0, box);
        const [x, y] = [key % across, Math.floor(key / across)];
        for (let j = Math.max(0, y - 1); j <= Math.min(down - 1, y + 1); j += 1) {
          for (let i = Math.max(0, x - 1); i <= Math.min(across - 1, x + 1); i += 1) open.push(j * across + i);
        }
      }
      found.push(area.get(0));
    }
    return found;
  };

  const join = (boxes, key, box) => {
    const known = boxes.get(key);
    if (!known) { boxes.set(key, { ...box }); return; }
    known.left = Math.min(known.left, box.left);
    known.top = Math.min(known.top, box.top);
    known.right = Math.max(known.right, box.right);
    known.bottom = Math.max(known.bottom, box.bottom);
    known.count += box.count;
    if (box.ratio > known.ratio) Object.assign(known, { ratio: box.ratio, at: box.at });
  };

  // An area of more than this share is nearly the whole image, so its outline would be useless.
  const ALL = 0.9;
  const isWhole = ({ left, top, right, bottom }, { width, height }) =>
    Math.min(width, height) >= SMALL && right - left + 1 >= ALL * width && bottom - top + 1 >= ALL * height;
  const SMALL = 16; // pixels; in a smaller area each pixel is visible

  const share = (part) => (part < 0.001 ? "less than 0.1 %" : `${numbers.rounded(100 * part)} %`);

  // Returns the number of refused pixels and their areas, worst first, for the first judged part.
  const of = (data) => {
    const [judged, ...others] = data?.parts ?? [];
    const { golden, actual } = judged ?? {};
    if (!golden || !actual || !data.gate || golden.width !== actual.width || golden.height !== actual.height) return null;
    if (data.refused !== undefined) return data.refused;
    const mask = others.find(({ name }) => name === "mask")?.actual ?? null;
    const ratios = refused(judged, data.gate, mask);
    const count = ratios.reduce((sum, ratio) => sum + (ratio > 0), 0);
    let boxes = [];
    // With very many pixels, the smallest cells take long, and would make too many areas.
    for (let cell = count > 10000 ? 4 : 1; count && cell <= 256; cell *= 2) {
      boxes = areas(ratios, golden.width, golden.height, cell);
      if (boxes.length <= MOST) break;
    }
    boxes.sort((a, b) => b.ratio - a.ratio || b.count - a.count);
    for (const box of boxes) box.whole = isWhole(box, golden);
    const spread = boxes.some(({ whole }) => whole) ? `${share(count / ratios.length)} of its pixels` : "";
    data.refused = { count, boxes, spread };
    return data.refused;
  };

  return { of };
})();
