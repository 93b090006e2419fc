// Mouse, touch, wheel and keyboard input. `move` takes shifts and turns as shares of the picture's width (right, down, yaw to the right,
// pitch down), and steps ahead as shares of the depth in view; `release` is called when the last pointer is lifted.
// Returns a function: whether any pointer is pressed.

const KEYS = { ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0], ArrowUp: [0, -1, 0], ArrowDown: [0, 1, 0], "+": [0, 0, 1], "=": [0, 0, 1], "-": [0, 0, -1] };
// Speed of the arrow keys, picture widths per second, and of + and -, shares of the depth per second.
const KEY_SPEED = 0.35;
const AHEAD_SPEED = 0.2;

export function listen(canvas, move, release) {
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
    // The scene follows the pointer: the viewpoint moves the other way.
    if (pointers.size === 2) move({ yaw: -dx, pitch: -dy, ahead: before > 0 ? (spread() - before) / canvas.clientWidth : 0 });
    else if (event.shiftKey) move({ yaw: -dx, pitch: -dy });
    else move({ right: -dx, down: -dy });
  });
  const up = (event) => {
    if (pointers.delete(event.pointerId) && pointers.size === 0) release();
  };
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
    const [right, down] = [KEY_SPEED * seconds * x, KEY_SPEED * seconds * y];
    move({ ...(turning ? { yaw: right, pitch: down } : { right, down }), ahead: AHEAD_SPEED * seconds * z });
    requestAnimationFrame(step);
  };
  addEventListener("keydown", (event) => {
    // Other elements handle these keys themselves.
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
  return () => pointers.size > 0;
}
