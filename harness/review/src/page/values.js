// The values of each pixel, written on the pixel if it is large enough: the channels of an image, the shown difference,
// or the value of a map.

(() => {
  const canvas = byId("values");
  const context = canvas.getContext("2d");
  const LEAST = 46; // points that a texel needs: four lines of digits
  const TINTS = ["#ff9d9d", "#a5f0a5", "#a9c4ff", "#e4e4e4"];

  const lines = ({ layer }, at) => {
    const { golden, actual } = part();
    if (layer === "map") {
      const map = loaded().maps[state.map];
      const value = map && texel(map.image, at);
      return !value || (map.scalar && !value[3]) ? [] : [...value].slice(0, map.scalar ? 1 : 4);
    }
    if (layer !== "difference") return [...(texel(part()[layer], at) ?? [])];
    const [g, a] = [texel(golden, at), texel(actual, at)];
    if (!g || !a) return [];
    const dark = (c) => (c === 3 ? 0.01 : golden.dark);
    return [...a].map((value, c) => (value - g[c]) / (state.relative ? Math.max(Math.abs(g[c]), dark(c)) : 1));
  };

  const looked = (c) => state.channel === 0 || state.channel === 5 || state.channel === c + 1;

  listeners.push(() => {
    const ratio = window.devicePixelRatio || 1;
    const step = state.scale / ratio;
    const wanted = state.values && part() && !loaded().table && !state.sheet && step >= LEAST;
    canvas.hidden = !wanted;
    if (!wanted) return;
    const { width, height } = stage.canvas;
    Object.assign(canvas, { width, height });
    const size = Math.min(13, (step - 6) / 4.4) * ratio;
    context.font = `${size}px ui-monospace, Consolas, "DejaVu Sans Mono", monospace`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineJoin = "round";
    context.lineWidth = 3 * ratio;
    context.strokeStyle = "rgb(0 0 0 / 75%)";
    for (const pane of stage.panes()) {
      const { x, y, w, h } = pane.clip;
      context.save();
      context.beginPath();
      context.rect(x, y, w, h);
      context.clip();
      const [left, top] = stage.origin(pane);
      const [first, last] = [stage.texelAt(pane, x, y), stage.texelAt(pane, x + w, y + h)];
      const [columns, rows] = extent();
      for (let row = Math.max(0, first[1]); row <= Math.min(rows - 1, last[1]); row += 1) {
        for (let column = Math.max(0, first[0]); column <= Math.min(columns - 1, last[0]); column += 1) {
          const all = lines(pane, [column, row]);
          const values = all.map((value, c) => [value, c]).filter(([, c]) => all.length === 1 || looked(c));
          values.forEach(([value, c], line) => {
            const text = numbers.rounded(value, pane.layer === "difference");
            const at = [left + (column + 0.5) * state.scale,
              top + (row + 0.5) * state.scale + (line - (values.length - 1) / 2) * 1.08 * size];
            context.strokeText(text, ...at, state.scale - 4 * ratio);
            context.fillStyle = all.length === 1 ? TINTS[3] : TINTS[c];
            context.fillText(text, ...at, state.scale - 4 * ratio);
          });
        }
      }
      context.restore();
    }
  });
})();
