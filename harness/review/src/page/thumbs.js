// Thumbnails of golden, frame and difference. They are drawn from the data of each case. While you wait for no other
// case, this data loads case by case, and isn't kept.

const thumbs = (() => {
  const [WIDTH, HEIGHT] = [192, 108];

  // Returns an image in which each pixel is made of some of the texels that it covers.
  const picture = ([width, height], colour) => {
    const scale = Math.min(WIDTH / width, HEIGHT / height, 8);
    const canvas = element("canvas", { width: Math.max(1, Math.round(width * scale)), height: Math.max(1, Math.round(height * scale)) });
    const context = canvas.getContext("2d");
    const picture = context.createImageData(canvas.width, canvas.height);
    const range = (at, side, count) => {
      const [from, to] = [Math.floor((at * side) / count), Math.ceil(((at + 1) * side) / count)];
      return [from, Math.min(side, Math.max(from + 1, to))];
    };
    for (let y = 0; y < canvas.height; y += 1) {
      for (let x = 0; x < canvas.width; x += 1) {
        const rgb = colour(range(x, width, canvas.width), range(y, height, canvas.height));
        picture.data.set([...rgb.map((value) => Math.round(255 * value)), 255], 4 * (y * canvas.width + x));
      }
    }
    context.putImageData(picture, 0, 0);
    return canvas;
  };

  const MAGENTA = [1, 0, 1];
  const light = (image) => {
    const exposure = 2 ** Math.round(Math.log2(0.18 / image.key));
    return picture([image.width, image.height], ([left, right], [top, bottom]) => {
      const sum = [0, 0, 0];
      for (let y = top; y < bottom; y += 1) {
        for (let x = left; x < right; x += 1) {
          const at = 4 * (y * image.width + x);
          for (let c = 0; c < 3; c += 1) sum[c] += image.values[at + c];
        }
      }
      if (sum.some(Number.isNaN)) return MAGENTA;
      const count = (right - left) * (bottom - top);
      return tones.all[0].map(sum.map((value) => (value / count) * exposure));
    });
  };

  // A pixel shows the largest difference of the covered texels, so that a single texel is visible.
  const difference = (part) => {
    const { golden, actual } = part;
    const factor = 2 ** gain.automatic(part, { relative: true, channel: 0, exposure: 0 });
    return picture([Math.min(golden.width, actual.width), Math.min(golden.height, actual.height)], ([left, right], [top, bottom]) => {
      let most = 0;
      for (let y = top; y < bottom; y += 1) {
        for (let x = left; x < right; x += 1) {
          const [i, j] = [4 * (y * golden.width + x), 4 * (y * actual.width + x)];
          for (let c = 0; c < 3; c += 1) {
            const [g, a] = [golden.values[i + c], actual.values[j + c]];
            const value = (factor * (a - g)) / Math.max(Math.abs(g), golden.dark);
            if (Number.isNaN(a - g) && !Object.is(a, g)) return MAGENTA;
            if (Math.abs(value) > Math.abs(most)) most = value;
          }
        }
      }
      return tones.signed(most);
    });
  };

  // Draws the thumbnail of the judged part, with its unusual values.
  const make = (entry) => {
    const [judged] = entry.data?.parts ?? [];
    if (!judged || entry.thumb) return;
    const { golden, actual } = judged;
    const sides = [golden, actual].filter(Boolean);
    entry.odd = {
      nan: sides.some(({ values }) => !values.every(Number.isFinite)),
      size: sides.length === 2 && (golden.width !== actual.width || golden.height !== actual.height),
    };
    const marked = golden && actual && difference(judged);
    // Single failing pixels are enlarged, as on the stage.
    const boxes = (marked && failing.of(entry.data)?.boxes) || [];
    for (const { left, top, right, bottom, at: [x, y] } of boxes) {
      const scale = marked.width / golden.width;
      if ((Math.max(right - left, bottom - top) + 1) * scale >= 4) continue;
      const context = marked.getContext("2d");
      context.fillStyle = actual.values[4 * (y * golden.width + x)] >= 0 ? "#ff8f7a" : "#f0f";
      context.fillRect(left * scale - 2, top * scale - 2, 5, 5);
    }
    entry.thumb = {
      golden: golden && light(golden),
      actual: actual && light(actual),
      difference: marked,
    };
  };

  // A canvas can only be in one place of the page, but a list may show it again.
  const copy = (made, className) => {
    if (!made) return element("span", { className });
    const canvas = element("canvas", { className, width: made.width, height: made.height });
    canvas.getContext("2d").drawImage(made, 0, 0);
    return canvas;
  };

  // Loads the next missing thumbnail after the shown case is loaded.
  let waiting = null;
  listeners.push(() => {
    const current = selectedCase();
    if (waiting || (current && current.index !== null && !current.data && !current.error)) return;
    if (state.cases.some(({ background }) => background)) return;
    // The thumbnails beside the shown case come first, because they are visible.
    const order = listed();
    const middle = Math.max(0, order.indexOf(state.selected));
    const near = [...order.keys()].sort((a, b) => Math.abs(a - middle) - Math.abs(b - middle));
    const next = near.map((at) => state.cases[order[at]])
      .find((entry) => entry.index !== null && !entry.table && !entry.thumb && !entry.error && ["pending", "golden"].includes(entry.status));
    if (!next) return;
    waiting = setTimeout(() => {
      waiting = null;
      if (next.data) { make(next); change(); return; }
      if (next.loading) return;
      next.background = true;
      load(next);
    }, 50);
  });

  return { make, copy, light };
})();
