// The pointer pans, zooms and inspects. One finger works like a mouse, and two fingers zoom.

(() => {
  const canvas = stage.canvas;
  const handle = byId("handle");
  const ratio = () => window.devicePixelRatio || 1;

  const position = (event) => {
    const box = canvas.getBoundingClientRect();
    return [(event.clientX - box.left) * ratio(), (event.clientY - box.top) * ratio()];
  };

  let dragged = null;
  const fingers = new Map(); // the positions of the pointers that are down
  const pinch = () => {
    const [a, b] = [...fingers.values()];
    return { middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2], apart: Math.max(1, Math.hypot(a[0] - b[0], a[1] - b[1])) };
  };
  const drag = (from) => { dragged = { from, center: state.center, moved: false }; };
  canvas.addEventListener("pointerdown", (event) => {
    if (!stage.gl || event.button > 1) return;
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, position(event));
    if (fingers.size === 1) drag(position(event));
    else dragged = null;
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!stage.gl) return;
    const [x, y] = position(event);
    // Two fingers zoom at their middle, and pan if they move together.
    if (fingers.size === 2 && fingers.has(event.pointerId)) {
      const before = pinch();
      fingers.set(event.pointerId, [x, y]);
      const now = pinch();
      const [dx, dy] = [now.middle[0] - before.middle[0], now.middle[1] - before.middle[1]];
      state.center = [state.center[0] - dx / state.scale, state.center[1] - dy / state.scale];
      zoom(now.apart / before.apart, now.middle);
      return;
    }
    if (fingers.has(event.pointerId)) fingers.set(event.pointerId, [x, y]);
    if (dragged) {
      const [dx, dy] = [x - dragged.from[0], y - dragged.from[1]];
      // A hand isn't steadier than this, and a finger is less steady.
      dragged.moved ||= Math.hypot(dx, dy) > (event.pointerType === "touch" ? 8 : 3) * ratio();
      if (dragged.moved) {
        const center = [dragged.center[0] - dx / state.scale, dragged.center[1] - dy / state.scale];
        change({ center, fit: false });
      }
    }
    change({ hover: stage.texelAt(paneAt(x, y), x, y) });
  });
  canvas.addEventListener("pointerup", (event) => {
    const others = fingers.size > 1;
    fingers.delete(event.pointerId);
    if (others) { // the remaining finger continues to drag, and doesn't pin
      if (fingers.size === 1) { drag([...fingers.values()][0]); dragged.moved = true; }
      return;
    }
    if (dragged && !dragged.moved) {
      const at = stage.texelAt(paneAt(...position(event)), ...position(event));
      const same = state.pinned && state.pinned.join() === at.join();
      const [width, height] = extent();
      const inside = at[0] >= 0 && at[1] >= 0 && at[0] < width && at[1] < height;
      change({ pinned: same || !inside ? null : at });
    }
    dragged = null;
  });
  canvas.addEventListener("pointercancel", (event) => { fingers.delete(event.pointerId); dragged = null; });
  canvas.addEventListener("pointerleave", () => change({ hover: null }));
  canvas.addEventListener("wheel", (event) => {
    if (!stage.gl) return;
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 40 : 1;
    zoom(2 ** (-event.deltaY * lines / 400), position(event));
  }, { passive: false });

  const slide = (event) => {
    const box = canvas.getBoundingClientRect();
    change({ swipe: Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)) });
  };
  handle.addEventListener("pointerdown", (event) => handle.setPointerCapture(event.pointerId));
  handle.addEventListener("pointermove", (event) => {
    if (handle.hasPointerCapture(event.pointerId)) slide(event);
  });
  handle.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -0.01, ArrowRight: 0.01 }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    change({ swipe: Math.min(1, Math.max(0, state.swipe + step)) });
  });
})();
