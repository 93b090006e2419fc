// The surface through the photos' positions on which the viewpoint moves, and the poses on it. Vectors are arrays; matrices are arrays of
// rows; cameras have the format of `liveview render --pose`: cam_from_world with x right, y down, z forward.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const add = (a, b, factor = 1) => a.map((x, i) => x + factor * b[i]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((x) => x / Math.hypot(...a));
const times = (m, v) => m.map((row) => dot(row, v));
const columns = (m) => [0, 1, 2].map((i) => m.map((row) => row[i]));
const mean = (vectors) => vectors.reduce((sum, v) => add(sum, v), [0, 0, 0]).map((x) => x / vectors.length);

const rotationOf = (camera) => camera.cam_from_world.slice(0, 3).map((row) => row.slice(0, 3));
export const centreOf = (camera) => {
  const translation = camera.cam_from_world.slice(0, 3).map((row) => row[3]);
  return times(columns(rotationOf(camera)), translation).map((x) => -x);
};

// The rotation that looks along `forward`, with its down axis as near to `down` as possible.
function facing(forward, down) {
  const ahead = unit(forward);
  const right = unit(cross(down, ahead));
  return [right, cross(ahead, right), ahead];
}

// The identity within [low, high]; beyond, it approaches the limit `margin` outside smoothly.
export function soft(x, low, high, margin) {
  if (x > high) return high + margin * (1 - Math.exp((high - x) / margin));
  if (x < low) return low - margin * (1 - Math.exp((x - low) / margin));
  return x;
}

export class Rig {
  // A rig around a view: of the photos whose viewing directions are within 60 degrees of its own.
  constructor(views, centreView, near) {
    const forward = rotationOf(views[centreView].camera)[2];
    const alike = views.filter((view) => dot(rotationOf(view.camera)[2], forward) > 0.5);
    const rotations = alike.map((view) => rotationOf(view.camera));
    this.templateCamera = views[centreView].camera;
    this.centre = mean(alike.map((view) => centreOf(view.camera)));
    this.rotation = facing(mean(rotations.map((r) => r[2])), mean(rotations.map((r) => r[1])));
    this.positions = alike.map((view) => this.toRig(centreOf(view.camera)));
    // 1 / distance of the point at which the optical axes converge, by least squares.
    const axes = rotations.map((r) => times(this.rotation, r[2]));
    const sums = this.positions.reduce(
      ([products, squares], p, i) => [products - axes[i][0] * p[0] - axes[i][1] * p[1], squares + p[0] ** 2 + p[1] ** 2], [0, 0]);
    this.convergence = sums[1] > 0 ? sums[0] / sums[1] : 0;
    const range = (axis) => [Math.min(...this.positions.map((p) => p[axis])), Math.max(...this.positions.map((p) => p[axis]))];
    [this.across, this.down] = [range(0), range(1)];
    const extent = Math.max(this.across[1] - this.across[0], this.down[1] - this.down[0]);
    this.extent = extent > 0 ? Math.min(extent, near) : 0.2 * near;
  }

  // Rig coordinates (right, down, forward from the rig's middle) of a point in the world.
  toRig(point) {
    return times(this.rotation, add(point, this.centre, -1));
  }

  // How far the surface lies in front of the rig's plane: the photos' distances, weighted by their nearness.
  surface(u, v) {
    let [sum, weights] = [0, 0];
    for (const position of this.positions) {
      const weight = 1 / ((position[0] - u) ** 2 + (position[1] - v) ** 2 + (0.05 * this.extent) ** 2);
      [sum, weights] = [sum + weight * position[2], weights + weight];
    }
    return sum / weights;
  }

  // Limits of each coordinate of a viewpoint: low, high, and the margin beyond.
  limits() {
    const margin = 0.2 * this.extent;
    return {
      u: [...this.across, margin], v: [...this.down, margin], z: [-margin, margin, margin], yaw: [-0.08, 0.08, 0.12], pitch: [-0.08, 0.08, 0.12],
    };
  }

  // The viewpoint with soft limits applied.
  bounded(place) {
    return Object.fromEntries(Object.entries(this.limits()).map(([key, limits]) => [key, soft(place[key], ...limits)]));
  }

  // The viewpoint clamped to twice the margin, so that moving back has an effect at once.
  within(place) {
    const clamped = ([key, [low, high, margin]]) => [key, Math.max(low - 2 * margin, Math.min(high + 2 * margin, place[key]))];
    return Object.fromEntries(Object.entries(this.limits()).map(clamped));
  }

  // The camera of a viewpoint: oriented as the photos are there, then turned by yaw (right) and pitch (down), radians.
  camera({ u, v, z, yaw, pitch }) {
    const world = columns(this.rotation);
    const centre = add(this.centre, times(world, [u, v, this.surface(u, v) + z]));
    const ahead = times(world, [-this.convergence * u, -this.convergence * v, 1]);
    const base = facing(ahead, this.rotation[1]);
    const turned = [Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch), Math.cos(pitch) * Math.cos(yaw)];
    const rotation = facing(times(columns(base), turned), base[1]);
    const translation = times(rotation, centre).map((x) => -x);
    return { ...this.templateCamera, cam_from_world: rotation.map((row, i) => [...row, translation[i]]) };
  }

  // The viewpoint of this rig that is nearest to a camera.
  viewpoint(camera) {
    const [u, v, w] = this.toRig(centreOf(camera));
    const base = rotationOf(this.camera({ u, v, z: 0, yaw: 0, pitch: 0 }));
    const forward = times(base, rotationOf(camera)[2]);
    return { u, v, z: w - this.surface(u, v), yaw: Math.atan2(forward[0], forward[2]), pitch: Math.asin(Math.max(-1, Math.min(1, forward[1]))) };
  }
}
