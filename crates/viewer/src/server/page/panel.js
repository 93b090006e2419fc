// The panel beside the picture: figures, the time of each stage, the map of the rig.

const STAGES = ["photos", "depth", "select", "warp", "network", "composite", "rest"];
// Number of recent pictures in the plot of times.
const PLOTTED_PICTURES = 60;
const element = (id) => document.getElementById(id);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const searching = ({ done, count }) => `depth of photo ${done + 1} of ${count}`;
const percent = (share) => `${(100 * share).toFixed(1)} %`;

// A canvas at the screen's resolution: its context, width and height in CSS pixels.
function prepared(canvas) {
  const [width, height, ratio] = [canvas.clientWidth, canvas.clientHeight, devicePixelRatio];
  [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  return [context, width, height];
}

export class Panel {
  constructor() {
    this.times = [];
    this.moving = [];
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    addEventListener("resize", () => this.draw());
  }

  session(info) {
    element("scene").textContent = info.scene;
    document.title = `${info.scene} · LiveView`;
    // Without a network, views are blended by distance and agreement.
    const labels = { rest: "other", network: info.engine === "no network" ? "blend" : "network" };
    const legend = STAGES.map((stage) => {
      const [item, box] = [document.createElement("span"), document.createElement("i")];
      box.style.background = `var(--${stage})`;
      item.append(box, labels[stage] ?? stage);
      return item;
    });
    element("legend").replaceChildren(...legend);
    for (const row of document.querySelectorAll(".held_out")) row.hidden = !info.views.some((view) => view.held_out);
    element("engine").textContent = `${info.engine}, ${info.threads} ${info.threads === 1 ? "thread" : "threads"}`;
  }

  picture(header, views, rig, place) {
    const now = performance.now();
    this.moving = this.moving.filter((time) => now - time < 1000);
    if (header.moving) this.moving.push(now);
    const known = Object.values(header.stages).reduce((sum, time) => sum + time, 0);
    // A picture that was rendered before and is only sent again took no time.
    if (header.milliseconds >= known) this.times.push({ ...header.stages, rest: header.milliseconds - known });
    this.times = this.times.slice(-PLOTTED_PICTURES);
    element("layers").textContent = header.layers;
    element("size").textContent = `${header.width} × ${header.height}`;
    element("uncovered").textContent = percent(header.uncovered + header.occluded);
    element("score").textContent = header.psnr === undefined ? "–" : `${views[header.truth].name}: ${header.psnr.toFixed(2)} dB`;
    const resting = header.search ? `draft, ${searching(header.search)}` : "full quality";
    this.figures = `${header.width} × ${header.height} · ${header.milliseconds.toFixed(0)} ms`;
    element("status").textContent = `${header.moving ? `${this.moving.length} frames a second` : resting} · ${this.figures}`;
    [this.header, this.views, this.rig, this.place] = [header, views, rig, place];
    // At most ten times a second, so that the picture goes first.
    this.drawing ??= setTimeout(() => {
      this.drawing = undefined;
      this.draw();
    }, 100);
  }

  // Progress of the depth search that the picture waits for.
  search(progress) {
    if (this.header?.search && !this.header.moving) element("status").textContent = `draft, ${searching(progress)} · ${this.figures}`;
  }

  draw() {
    if (!this.header) return;
    this.drawTimes();
    this.drawMap();
  }

  drawTimes() {
    const [context, width, height] = prepared(element("plot"));
    const totals = this.times.map((times) => STAGES.reduce((sum, stage) => sum + times[stage], 0));
    // The scale follows the 90th percentile: a slow picture that waited for depth does not flatten all others.
    const scale = height / (1.2 * Math.max(20, [...totals].sort((a, b) => a - b)[Math.floor(0.9 * (totals.length - 1))]));
    this.times.forEach((times, i) => {
      let top = height;
      for (const stage of STAGES) {
        const size = scale * times[stage];
        context.fillStyle = colour(stage);
        context.fillRect((i * width) / PLOTTED_PICTURES, top - size, width / PLOTTED_PICTURES - 1, size);
        top -= size;
      }
    });
    element("rate").textContent = totals.length > 0 ? `${totals[totals.length - 1].toFixed(0)} ms` : "";
  }

  // The mapping from a point (right, down from the rig's middle, scene units) to the map.
  mapTransform(width, height) {
    const { across, down, extent } = this.rig;
    const [w, h] = [across[1] - across[0] + 0.6 * extent, down[1] - down[0] + 0.6 * extent];
    const factor = Math.min(width / w, height / h);
    return ([u, v]) => [width / 2 + factor * (u - (across[0] + across[1]) / 2), height / 2 + factor * (v - (down[0] + down[1]) / 2)];
  }

  drawMap() {
    const [context, width, height] = prepared(element("map"));
    const at = this.mapTransform(width, height);
    this.spots = this.views.map((view) => at(this.rig.toRig(view.centre)));
    const here = at([this.place.u, this.place.v]);
    const lines = (views, stroke) => {
      context.strokeStyle = stroke;
      for (const view of views) {
        context.beginPath();
        context.moveTo(...here);
        context.lineTo(...this.spots[view]);
        context.stroke();
      }
    };
    lines(this.header.helpers, colour("line"));
    lines(this.header.views, colour("accent"));
    const disc = ([x, y], radius) => {
      context.beginPath();
      context.arc(x, y, radius, 0, 2 * Math.PI);
    };
    this.views.forEach((view, i) => {
      disc(this.spots[i], 3.5);
      context.fillStyle = colour(this.header.views.includes(i) ? "accent" : "faint");
      context.strokeStyle = colour("depth");
      view.held_out ? context.stroke() : context.fill();
    });
    disc(here, 5);
    context.fillStyle = colour("alarm");
    context.fill();
  }

  // The view nearest to the viewpoint on the map, and from there the nearest one in a direction (right, down).
  viewTowards([right, down]) {
    if (!this.spots) return undefined;
    const here = this.mapTransform(element("map").clientWidth, element("map").clientHeight)([this.place.u, this.place.v]);
    const costs = this.spots.map(([x, y]) => {
      const [dx, dy] = [x - here[0], y - here[1]];
      const ahead = dx * right + dy * down;
      // A view three times as far ahead counts as near as one to the side.
      return ahead > 1 ? ahead + 3 * Math.abs(dx * down - dy * right) : Infinity;
    });
    const best = costs.indexOf(Math.min(...costs));
    return costs[best] < Infinity ? best : undefined;
  }

  // The view near a point on the map.
  viewAt(x, y) {
    const distances = (this.spots ?? []).map((spot) => Math.hypot(spot[0] - x, spot[1] - y));
    const nearest = distances.indexOf(Math.min(...distances));
    return distances[nearest] < 14 ? nearest : undefined;
  }

  message(text) {
    element("message").hidden = !text;
    element("message").textContent = text ?? "";
  }
}
