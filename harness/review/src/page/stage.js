// The canvas: the panes, their images as float textures, and the drawing of each pane.

const stage = (() => {
  const canvas = byId("canvas");
  // The drawing is kept, so that the browser can show and save the canvas at any time.
  const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
  if (!gl) return { canvas, gl, panes: () => [], draw() {} };

  const compiled = (kind, text) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    return shader;
  };
  // A browser may take all graphics memory back, and restore it later. Older objects are then invalid.
  let vertex = compiled(gl.VERTEX_SHADER, VERTEX);
  let generation = 0;
  canvas.addEventListener("webglcontextlost", (event) => {
    event.preventDefault(); // otherwise the browser never restores the context
    change();
  });
  canvas.addEventListener("webglcontextrestored", () => {
    generation += 1;
    programs.clear();
    vertex = compiled(gl.VERTEX_SHADER, VERTEX);
    change();
  });
  const UNIFORMS = ["golden", "actual", "map", "goldenSize", "actualSize", "mapSize", "origin",
    "scale", "height", "exposure", "marks", "grid", "gain", "dark", "range"];

  // Returns the program for these choices, and the locations of its uniforms. Each program is made once.
  const programs = new Map();
  const programOf = (choices) => {
    const key = JSON.stringify(choices);
    if (!programs.has(key)) {
      const program = gl.createProgram();
      const shader = compiled(gl.FRAGMENT_SHADER, fragment(choices));
      gl.attachShader(program, vertex);
      gl.attachShader(program, shader);
      gl.linkProgram(program);
      if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
        throw new Error(`${gl.getProgramInfoLog(program)} ${gl.getShaderInfoLog(shader)}`);
      }
      const places = UNIFORMS.map((name) => [name, gl.getUniformLocation(program, name)]);
      programs.set(key, { program, uniforms: Object.fromEntries(places) });
    }
    return programs.get(key);
  };

  // Returns the texture of an image, and makes it when the image is first drawn. A missing texel is black.
  const nothing = { width: 0, height: 0, values: new Float32Array(4) };
  const bind = (uniforms, unit, name, image) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    if (!image.texture || image.generation !== generation) {
      image.texture = gl.createTexture();
      image.generation = generation;
      gl.bindTexture(gl.TEXTURE_2D, image.texture);
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, image.width || 1, image.height || 1, 0, gl.RGBA,
        gl.FLOAT, image.values);
      for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
        gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
      }
      for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) {
        gl.texParameteri(gl.TEXTURE_2D, wrap, gl.CLAMP_TO_EDGE);
      }
    }
    gl.bindTexture(gl.TEXTURE_2D, image.texture);
    gl.uniform1i(uniforms[name], unit);
    gl.uniform2i(uniforms[`${name}Size`], image.width, image.height);
  };

  // Frees the textures of a case that is no longer shown.
  const forget = (images) => {
    for (const image of images.filter((image) => image?.texture)) {
      if (image.generation === generation) gl.deleteTexture(image.texture);
      image.texture = null;
    }
  };

  const LAYERS = { golden: 0, actual: 1, difference: 2, map: 3 };
  const GAP = 2; // pixels of the screen between panes

  // Returns the layout, in pixels of the canvas from the top left. `clip` is the visible part of each pane.
  const panes = () => {
    const [w, h] = [canvas.width, canvas.height];
    const whole = { x: 0, y: 0, w, h };
    const one = (layer) => [{ layer, ...whole, clip: whole }];
    if (state.view === "side" && !part()?.golden) return one("actual");
    if (state.view === "side" && !part()?.actual) return one("golden");
    if (state.view === "side") {
      const [width, height] = extent();
      const half = { w: Math.floor((w - GAP) / 2), h: Math.floor((h - GAP) / 2) };
      // The panes are beside or below each other, whichever shows larger images.
      const beside = Math.min(half.w / width, h / height) >= Math.min(w / width, half.h / height);
      const first = beside ? { x: 0, y: 0, w: half.w, h } : { x: 0, y: 0, w, h: half.h };
      const second = beside ? { ...first, x: w - half.w } : { ...first, y: h - half.h };
      return [{ layer: "golden", ...first, clip: first }, { layer: "actual", ...second, clip: second }];
    }
    if (state.view === "swipe") {
      const split = Math.round(w * state.swipe);
      return [
        { layer: "golden", ...whole, clip: { x: 0, y: 0, w: split, h } },
        { layer: "actual", ...whole, clip: { x: split, y: 0, w: w - split, h } },
      ];
    }
    if (state.view === "flip") return one(state.phase ? "actual" : "golden");
    return one(state.view);
  };

  // Returns the scale at which a whole image fits into a pane. Whole numbers make all texels equally large.
  const fitting = () => {
    const [{ w, h }] = panes();
    const [width, height] = extent();
    const scale = Math.min(w / width, h / height);
    return scale >= 1 ? Math.floor(scale) : scale;
  };

  // Returns the position of the image's top left corner. It is a whole number of pixels, so that texels and pixels
  // coincide at 1:1.
  const origin = ({ x, y, w, h }) => [
    Math.round(x + w / 2 - state.center[0] * state.scale),
    Math.round(y + h / 2 - state.center[1] * state.scale),
  ];

  // Returns the texel at a pixel of the canvas.
  const texelAt = (pane, x, y) => {
    const [left, top] = origin(pane);
    return [Math.floor((x - left) / state.scale), Math.floor((y - top) / state.scale)];
  };

  // The backing store has one pixel for each pixel of the screen that the element covers.
  const resize = () => {
    const ratio = window.devicePixelRatio || 1;
    const [w, h] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(1, Math.round(side * ratio)));
    if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
  };

  const draw = () => {
    resize();
    if (gl.isContextLost()) return;
    if (state.fit) {
      const [width, height] = extent();
      Object.assign(state, { scale: fitting(), center: [width / 2, height / 2] });
    }
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0.08, 0.08, 0.08, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.SCISSOR_TEST);
    gl.viewport(0, 0, canvas.width, canvas.height);
    for (const pane of panes()) {
      const { x, y, w, h } = pane.clip;
      if (w <= 0 || h <= 0) continue;
      gl.scissor(x, canvas.height - y - h, w, h);
      drawPane(pane);
    }
  };

  const drawPane = (pane) => {
    const { golden, actual } = part() ?? {};
    const map = loaded()?.maps[state.map];
    const { tone, channel, falseColor, relative, how, scale } = state;
    const samples = Math.min(8, Math.ceil(1 / scale));
    const scalarMap = map?.scalar ?? false;
    const layer = LAYERS[pane.layer];
    const choices = { layer, tone, channel, falseColor, relative, how, scalarMap, samples };
    const { program, uniforms } = programOf(choices);
    gl.useProgram(program);
    bind(uniforms, 0, "golden", golden ?? nothing);
    bind(uniforms, 1, "actual", actual ?? nothing);
    bind(uniforms, 2, "map", map?.image ?? nothing);
    gl.uniform1f(uniforms.scale, scale);
    gl.uniform1f(uniforms.height, canvas.height);
    gl.uniform1f(uniforms.exposure, 2 ** state.exposure);
    gl.uniform1f(uniforms.gain, 2 ** state.gain);
    gl.uniform1f(uniforms.dark, golden?.dark ?? 1);
    gl.uniform2f(uniforms.range, ...(map?.range ?? [0, 1]));
    gl.uniform1i(uniforms.marks, state.marks);
    gl.uniform1i(uniforms.grid, state.grid);
    gl.uniform2f(uniforms.origin, ...origin(pane));
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  };

  return { canvas, gl, panes, origin, texelAt, draw, forget };
})();

// Zooms, and keeps the texel at a pixel of the canvas in its place.
function zoom(factor, at = null) {
  const { panes, origin } = stage;
  const [x, y] = at ?? [panes()[0].w / 2, panes()[0].h / 2];
  const pane = paneAt(x, y);
  const [left, top] = origin(pane);
  const texel = [(x - left) / state.scale, (y - top) / state.scale];
  const scale = Math.min(256, Math.max(1 / 32, state.scale * factor));
  const center = [
    texel[0] + (pane.x + pane.w / 2 - x) / scale,
    texel[1] + (pane.y + pane.h / 2 - y) / scale,
  ];
  change({ scale, center, fit: false });
}

// Moves a rectangle of texels to the middle of each pane, with some of its surroundings.
function lookAt([left, top, right, bottom], pinned = [left, top]) {
  const [pane] = stage.panes();
  const around = Math.max(right - left + 1, bottom - top + 1, 2) * 5; // single pixels are large enough for their values
  const scale = Math.max(1, Math.floor(Math.min(pane.w, pane.h) / around));
  const center = [(left + right + 1) / 2, (top + bottom + 1) / 2];
  change({ scale, center, fit: false, pinned });
}

function paneAt(x, y) {
  const inside = ({ clip }) => x >= clip.x && y >= clip.y && x < clip.x + clip.w && y < clip.y + clip.h;
  const panes = stage.panes();
  return panes.find(inside) ?? panes[0];
}
