// Vectors are arrays, matrices arrays of rows. Cameras have the format of `liveview render --pose`: cam_from_world with x right, y down,
// z forward; pixels, the centre of the first at 0.5.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const add = (a, b, factor = 1) => a.map((x, i) => x + factor * b[i]);
const scaled = (a, factor) => a.map((x) => x * factor);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = (a) => Math.hypot(...a);
const unit = (a) => scaled(a, 1 / (norm(a) || 1));
const times = (m, v) => m.map((row) => dot(row, v));
const transposed = (m) => [0, 1, 2].map((i) => m.map((row) => row[i]));
const product = (a, b) => a.map((row) => transposed(b).map((column) => dot(row, column)));
const distance = (a, b) => norm(add(a, b, -1));
const clamp = (x, low, high) => Math.max(low, Math.min(high, x));
const median = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];

// A pose: rotation (rows right, down, forward in the world) and centre.
const poseOf = (camera) => {
  const rotation = camera.cam_from_world.slice(0, 3).map((row) => row.slice(0, 3));
  const translation = camera.cam_from_world.slice(0, 3).map((row) => row[3]);
  return { rotation, centre: scaled(times(transposed(rotation), translation), -1) };
};

// A camera with another pose.
const cameraAt = (camera, { rotation, centre }) => {
  const translation = scaled(times(rotation, centre), -1);
  return { ...camera, cam_from_world: rotation.map((row, i) => [...row, translation[i]]) };
};

// The rotation that looks along `forward`, with its down axis as near to `down` as possible.
const facing = (forward, down) => {
  const ahead = unit(forward);
  const sideways = cross(down, ahead);
  const right = norm(sideways) > 1e-9 ? unit(sideways) : unit(cross(Math.abs(ahead[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0], ahead));
  return [right, cross(ahead, right), ahead];
};

// A rotation by an angle (radians) about an axis of length 1.
const turn = (axis, angle) => {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const [x, y, z] = axis;
  return [
    [c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s],
    [y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s],
    [z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)],
  ];
};

// The pose between two, at a share of the way: the rotation about one axis, the centre on a straight line.
const between = (a, b, share) => {
  const change = product(b.rotation, transposed(a.rotation));
  const angle = Math.acos(clamp((change[0][0] + change[1][1] + change[2][2] - 1) / 2, -1, 1));
  const axis = [change[2][1] - change[1][2], change[0][2] - change[2][0], change[1][0] - change[0][1]];
  const rotation = angle > 1e-6 && norm(axis) > 1e-9 ? product(turn(unit(axis), angle * share), a.rotation) : b.rotation;
  return { rotation, centre: add(a.centre, add(b.centre, a.centre, -1), share) };
};

// A camera's matrix, and that of the same picture at another size.
const matrixOf = ({ fl_x, fl_y, cx, cy, skew = 0 }) => [[fl_x, skew, cx], [0, fl_y, cy], [0, 0, 1]];
const resized = (camera, w, h) => {
  const [x, y] = [w / camera.w, h / camera.h];
  return { ...camera, fl_x: camera.fl_x * x, cx: camera.cx * x, fl_y: camera.fl_y * y, cy: camera.cy * y, skew: (camera.skew ?? 0) * x, w, h };
};

// H and e such that a pixel p (x, y, 1) of `from` at disparity d (1/depth) is at (u/w, v/w) of `to`, with disparity d/w, where (u, v, w) = H p + d e.
const sweep = (to, from) => {
  const [a, b] = [poseOf(to), poseOf(from)];
  const skew = (from.skew ?? 0) / from.fl_y;
  const inverse = [[1 / from.fl_x, -skew / from.fl_x, (skew * from.cy - from.cx) / from.fl_x], [0, 1 / from.fl_y, -from.cy / from.fl_y], [0, 0, 1]];
  const rotation = product(a.rotation, transposed(b.rotation));
  return { H: product(matrixOf(to), product(rotation, inverse)), e: times(matrixOf(to), times(a.rotation, add(b.centre, a.centre, -1))) };
};
const swept = ({ H, e }, x, y, d) => {
  const [u, v, w] = [0, 1, 2].map((i) => H[i][0] * x + H[i][1] * y + H[i][2] + d * e[i]);
  return [u / w, v / w, d / w, w];
};
