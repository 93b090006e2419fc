// Mouse, touch, wheel and keyboard. `on`: orbit(dx, dy) and pan(dx, dy), in shares of the picture's width; dolly(share of the depth in the
// middle); begin() and end() of a gesture.

const KEYS = { ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0], ArrowUp: [0, -1, 0], ArrowDown: [0, 1, 0], "+": [0, 0, 1], "=": [0, 0, 1], "-": [0, 0, -1] };
// Picture widths per second of the arrow keys, and shares of the depth per second of + and -.
const KEY_SPEED = [0.35, 0.35, 0.4];

function listen(canvas, on) {
  const pointers = new Map();
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    canvas.focus({ preventScroll: true });
    if (pointers.size === 0) on.begin();
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY, pans: event.button !== 0 });
  });
  canvas.addEventListener("pointermove", (event) => {
    const pointer = pointers.get(event.pointerId);
    if (!pointer) return;
    const before = pointers.size === 2 ? spread() : 0;
    const width = canvas.clientWidth * pointers.size;
    const [dx, dy] = [(event.clientX - pointer.x) / width, (event.clientY - pointer.y) / width];
    [pointer.x, pointer.y] = [event.clientX, event.clientY];
    if (pointers.size === 2) {
      on.pan(dx, dy);
      if (before > 0) on.dolly(1 - before / Math.max(spread(), 1));
    } else if (event.shiftKey || pointer.pans) on.pan(dx, dy);
    else on.orbit(dx, dy);
  });
  const up = (event) => {
    if (pointers.delete(event.pointerId) && pointers.size === 0) on.end();
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  let wheelEnd;
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (!wheelEnd) on.begin();
    clearTimeout(wheelEnd);
    wheelEnd = setTimeout(() => {
      wheelEnd = undefined;
      on.end();
    }, 200);
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    on.dolly(clamp(-0.0012 * lines * event.deltaY * (event.ctrlKey ? 6 : 1), -0.3, 0.3));
  }, { passive: false });

  const held = new Set();
  let [pans, last] = [false, 0];
  const step = (now) => {
    if (held.size === 0) return on.end();
    const seconds = Math.min(0.1, (now - last) / 1000);
    last = now;
    const [x, y, z] = [...held].map((key) => KEYS[key]).reduce((sum, key) => sum.map((value, i) => value + key[i] * KEY_SPEED[i] * seconds), [0, 0, 0]);
    if (x || y) pans ? on.pan(-x, -y) : on.orbit(-x, -y);
    if (z) on.dolly(z);
    requestAnimationFrame(step);
  };
  canvas.addEventListener("keydown", (event) => {
    if (!(event.key in KEYS) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    pans = event.shiftKey && event.key.startsWith("Arrow");
    if (held.size === 0) {
      on.begin();
      requestAnimationFrame((now) => { last = now - 16; step(now); });
    }
    held.add(event.key);
  });
  addEventListener("keyup", (event) => held.delete(event.key));
  addEventListener("blur", () => held.clear());
}
