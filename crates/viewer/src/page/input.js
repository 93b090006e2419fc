// Mouse, fingers, wheel and keys: how far each moves the viewpoint. `move` takes shares of the picture's width (right, down, turn right,
// turn down) and steps ahead, in parts of the depth that is looked at.

const KEYS = { ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0], ArrowUp: [0, -1, 0], ArrowDown: [0, 1, 0], "+": [0, 0, 1], "=": [0, 0, 1], "-": [0, 0, -1] };
// Pictures' widths, and parts of the depth, per second.
const KEY_PACE = 0.35;
const AHEAD_PACE = 0.2;

export function listen(canvas, move) {
  const pointers = new Map();
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    canvas.focus({ preventScroll: true });
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const pointer = pointers.get(event.pointerId);
    if (!pointer) return;
    const before = pointers.size === 2 ? spread() : 0;
    const width = canvas.clientWidth * pointers.size;
    const [dx, dy] = [(event.clientX - pointer.x) / width, (event.clientY - pointer.y) / width];
    [pointer.x, pointer.y] = [event.clientX, event.clientY];
    // The scene follows the hand, so that the viewpoint goes the other way.
    if (pointers.size === 2) move({ yaw: -dx, pitch: -dy, ahead: before > 0 ? (spread() - before) / canvas.clientWidth : 0 });
    else if (event.shiftKey) move({ yaw: -dx, pitch: -dy });
    else move({ right: -dx, down: -dy });
  });
  const up = (event) => pointers.delete(event.pointerId);
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    move({ ahead: -0.0004 * lines * event.deltaY });
  }, { passive: false });

  const held = new Set();
  let [turning, last] = [false, 0];
  const step = (now) => {
    if (held.size === 0) return;
    const seconds = Math.min(0.1, (now - last) / 1000);
    last = now;
    const [x, y, z] = [...held].map((key) => KEYS[key]).reduce((sum, key) => sum.map((value, i) => value + key[i]), [0, 0, 0]);
    const [right, down] = [KEY_PACE * seconds * x, KEY_PACE * seconds * y];
    move({ ...(turning ? { yaw: right, pitch: down } : { right, down }), ahead: AHEAD_PACE * seconds * z });
    requestAnimationFrame(step);
  };
  addEventListener("keydown", (event) => {
    // Elsewhere keys have their own meaning.
    if (event.target !== document.body && event.target !== canvas) return;
    if (!(event.key in KEYS) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    turning = event.shiftKey && event.key.startsWith("Arrow");
    const first = held.size === 0;
    held.add(event.key);
    if (first) requestAnimationFrame((now) => { last = now - 16; step(now); });
  });
  addEventListener("keyup", (event) => held.delete(event.key));
  addEventListener("blur", () => held.clear());
}
