// Which photos a view is drawn from: the rule of src/geometry/view_selection.rs. Of the ten nearest photos that look within 60 degrees of the
// target's direction, one after the other: the one with the lowest distance · (1 + 0.3 c) / √(g + 0.001), where c is the largest positive cosine
// between its direction from the target and those of the photos chosen, and g the mean, over points of the target at three depths that it sees,
// of 1, 1/2, 1/4, 0.12 or 0.06 by how many chosen photos see the point too. Of a photo in `kept` the cost is a tenth lower.

const POOL = 10;
const GRID = 12;
const WORTH = [1, 0.5, 0.25, 0.12, 0.06];

// The depth at which the optical axes of these poses pass nearest to the target's; `fallback` where most do not meet it.
function focus(target, poses, fallback) {
  const [c, f] = [target.centre, target.rotation[2]];
  const depths = poses.flatMap(({ centre, rotation }) => {
    const [offset, b] = [add(c, centre, -1), dot(f, rotation[2])];
    const [d, e] = [dot(f, offset), dot(rotation[2], offset)];
    const [ahead, other] = [(b * e - d) / (1 - b * b), (e - b * d) / (1 - b * b)];
    return 1 - b * b > 1e-6 && ahead > 0 && other > 0 ? [ahead] : [];
  });
  return 2 * depths.length > poses.length ? median(depths) : fallback;
}

// `views`: each with camera and pose. Returns indices, nearest first.
function choose(views, candidates, target, count, kept = []) {
  const pose = poseOf(target);
  const far = (view) => Math.max(distance(views[view].pose.centre, pose.centre), 1e-12);
  const ahead = candidates.filter((view) => dot(views[view].pose.rotation[2], pose.rotation[2]) > 0.5).sort((a, b) => far(a) - far(b));
  // Behind all photos, or turned away from them: the nearest, whatever they look at.
  const facingAlike = ahead.length > 0 ? ahead : [...candidates].sort((a, b) => far(a) - far(b));
  const pool = facingAlike.slice(0, POOL);
  if (pool.length <= count) return pool;
  const base = median(pool.map(far));
  const depth = Math.max(focus(pose, pool.map((view) => views[view].pose), 10 * base), base);
  const sees = pool.map((view) => {
    const { camera } = views[view];
    const onto = sweep(camera, target);
    const seen = new Uint8Array(3 * GRID * GRID);
    for (let at = 0; at < seen.length; at += 1) {
      const [x, y] = [((at % GRID) + 0.5) / GRID, ((Math.floor(at / GRID) % GRID) + 0.5) / GRID];
      const [u, v, , w] = swept(onto, x * target.w, y * target.h, 1 / (depth * [0.6, 1, 2][Math.floor(at / GRID / GRID)]));
      seen[at] = w > 0 && u >= 0 && v >= 0 && u < camera.w && v < camera.h ? 1 : 0;
    }
    return seen;
  });
  const directions = pool.map((view) => unit(add(views[view].pose.centre, pose.centre, -1)));
  const [chosen, known] = [[], new Uint8Array(3 * GRID * GRID)];
  while (chosen.length < count) {
    let [best, lowest] = [-1, Infinity];
    for (let i = 0; i < pool.length; i += 1) {
      if (chosen.includes(i)) continue;
      const cosine = Math.max(0, ...chosen.map((other) => dot(directions[i], directions[other])));
      let gain = 0;
      for (let at = 0; at < known.length; at += 1) if (sees[i][at]) gain += WORTH[Math.min(known[at], 4)];
      const cost = ((kept.includes(pool[i]) ? 0.9 : 1) * far(pool[i]) * (1 + 0.3 * cosine)) / Math.sqrt(gain / known.length + 1e-3);
      // Of costs that differ by rounding the nearest photo's.
      if (cost < lowest * (1 - 1e-9)) [best, lowest] = [i, cost];
    }
    chosen.push(best);
    for (let at = 0; at < known.length; at += 1) known[at] += sees[best][at];
  }
  return chosen.map((i) => pool[i]).sort((a, b) => far(a) - far(b));
}
