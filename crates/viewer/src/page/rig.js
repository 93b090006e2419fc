// The rig in 3-D: a frustum for each photo, with the photo, and one for the viewpoint; it is turned by dragging, and a click goes to a photo.

class RigMap {
  // `go(view)`: called with the photo that was clicked.
  constructor(canvas, views, go) {
    Object.assign(this, { canvas, views, yaw: 0.5, pitch: 0.45, hits: [], chosen: [] });
    const centres = views.map((view) => view.pose.centre);
    const mean = (vectors) => scaled(vectors.reduce((sum, v) => add(sum, v), [0, 0, 0]), 1 / vectors.length);
    this.down = unit(mean(views.map((view) => view.pose.rotation[1])));
    const ahead = mean(views.map((view) => view.pose.rotation[2]));
    this.base = facing(norm(ahead) > 0.2 ? ahead : views[0].pose.rotation[2], this.down);
    const extent = Math.max(...centres.map((centre) => distance(centre, mean(centres))), 1e-6);
    this.extent = extent;
    // Frustums as long as a photo has room.
    const nearest = centres.map((a, i) => Math.min(...centres.filter((_, j) => j !== i).map((b) => distance(a, b)), extent));
    this.length = clamp(median(nearest), 0.1 * extent, 0.5 * extent);
    this.middle = add(mean(centres), this.base[2], 0.15 * extent);
    let at;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      at = { x: event.clientX, y: event.clientY, moved: 0 };
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!at) return;
      const [dx, dy] = [event.clientX - at.x, event.clientY - at.y];
      at = { x: event.clientX, y: event.clientY, moved: at.moved + Math.abs(dx) + Math.abs(dy) };
      this.turn(dx / 120, dy / 120);
    });
    canvas.addEventListener("pointerup", (event) => {
      const hit = at && at.moved < 6 ? this.viewAt(event.offsetX, event.offsetY) : undefined;
      at = undefined;
      if (hit !== undefined) go(hit);
    });
    canvas.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-0.2, 0], ArrowRight: [0.2, 0], ArrowUp: [0, -0.2], ArrowDown: [0, 0.2] }[event.key];
      if (!step) return;
      event.preventDefault();
      this.turn(...step);
    });
    addEventListener("resize", () => this.draw());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  turn(yaw, pitch) {
    [this.yaw, this.pitch] = [this.yaw + yaw, clamp(this.pitch + pitch, -1.5, 1.5)];
    this.draw();
  }

  // `shown`: the viewpoint's camera; `chosen`: indices of the photos that it is drawn from.
  update(shown, chosen) {
    [this.shown, this.chosen] = [shown, chosen];
    // Not with every frame.
    this.waiting ??= setTimeout(() => {
      this.waiting = undefined;
      this.draw();
    }, 120);
  }

  draw() {
    const { canvas } = this;
    const [width, height, ratio] = [canvas.clientWidth, canvas.clientHeight, Math.min(devicePixelRatio, 2)];
    if (!width || !this.shown) return;
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
    const turned = product(turn([1, 0, 0], this.pitch), product(turn([0, 1, 0], this.yaw), this.base));
    const [back, focal] = [3.2 * this.extent, 1.8 * Math.min(width, height)];
    const project = (point) => {
      const [x, y, z] = times(turned, add(point, this.middle, -1));
      const depth = Math.max(z + back, 0.05 * back);
      return [width / 2 + (focal * x) / depth, height / 2 + (focal * y) / depth, depth];
    };
    const corners = (camera, pose, length) => [[0, 0], [1, 0], [1, 1], [0, 1]].map(([x, y]) => {
      const ray = [(x * camera.w - camera.cx) / camera.fl_x, (y * camera.h - camera.cy) / camera.fl_y, 1];
      return project(add(pose.centre, times(transposed(pose.rotation), ray), length));
    });
    const frustum = (apex, plane, stroke, wide) => {
      [context.strokeStyle, context.lineWidth] = [stroke, wide];
      context.beginPath();
      plane.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.closePath();
      plane.forEach(([x, y]) => {
        context.moveTo(apex[0], apex[1]);
        context.lineTo(x, y);
      });
      context.stroke();
    };
    const order = this.views.map((view, i) => ({ view, i, apex: project(view.pose.centre) })).sort((a, b) => b.apex[2] - a.apex[2]);
    this.hits = [];
    for (const { view, i, apex } of order) {
      const plane = corners(view.camera, view.pose, 0.6 * this.length);
      const [a, b, , d] = plane;
      const thumbnail = view.thumbnail;
      if (thumbnail) {
        context.save();
        context.globalAlpha = 0.9;
        context.transform((b[0] - a[0]) / thumbnail.width, (b[1] - a[1]) / thumbnail.width, (d[0] - a[0]) / thumbnail.height, (d[1] - a[1]) / thumbnail.height, a[0], a[1]);
        context.drawImage(thumbnail, 0, 0);
        context.restore();
      }
      const isChosen = this.chosen.includes(i);
      frustum(apex, plane, colour(view.held_out ? "warm" : isChosen ? "accent" : "faint"), isChosen || view.held_out ? 1.6 : 0.7);
      this.hits.push({ i, x: (plane[0][0] + plane[2][0] + apex[0]) / 3, y: (plane[0][1] + plane[2][1] + apex[1]) / 3 });
    }
    const pose = poseOf(this.shown);
    frustum(project(pose.centre), corners(this.shown, pose, 0.8 * this.length), colour("alarm"), 2);
  }

  // The photo at a point of the canvas.
  viewAt(x, y) {
    const far = (hit) => Math.hypot(hit.x - x, hit.y - y);
    const best = this.hits.reduce((one, hit) => (!one || far(hit) <= far(one) ? hit : one), undefined);
    return best && far(best) < 30 ? best.i : undefined;
  }
}
