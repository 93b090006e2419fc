// A path that is recorded: viewpoints with their times, saved as cameras at even intervals.

// Cameras per second, and the time over which the path is smoothed, milliseconds.
const RATE = 30;
const SMOOTHING = 120;
const KEYS = ["u", "v", "z", "yaw", "pitch"];

export class Recorder {
  // `rig`: the surface on which the viewpoints of the path are described.
  constructor(rig, camera) {
    [this.rig, this.samples] = [rig, []];
    this.add(camera);
  }

  add(camera) {
    this.samples.push({ time: performance.now(), camera, place: this.rig.viewpoint(camera) });
  }

  get seconds() {
    return (this.samples[this.samples.length - 1].time - this.samples[0].time) / 1000;
  }

  // The viewpoint at a time, between the samples around it.
  placeAt(time) {
    const next = this.samples.findIndex((sample) => sample.time >= time);
    if (next === 0) return this.samples[0].place;
    if (next < 0) return this.samples[this.samples.length - 1].place;
    const [a, b] = [this.samples[next - 1], this.samples[next]];
    const share = (time - a.time) / (b.time - a.time);
    return Object.fromEntries(KEYS.map((key) => [key, a.place[key] + share * (b.place[key] - a.place[key])]));
  }

  // The path's cameras; the first and the last are those of the first and the last sample.
  cameras() {
    const [first, last] = [this.samples[0], this.samples[this.samples.length - 1]];
    const steps = Math.round(this.seconds * RATE);
    const cameras = [];
    for (let step = 1; step < steps; step += 1) {
      const time = first.time + (step * 1000) / RATE;
      // Less is smoothed near the ends, where the path is cut.
      const reach = Math.min(SMOOTHING, time - first.time, last.time - time);
      const around = [-1, -0.5, 0, 0.5, 1].map((share) => this.placeAt(time + share * reach));
      const place = Object.fromEntries(KEYS.map((key) => [key, around.reduce((sum, one) => sum + one[key] / around.length, 0)]));
      cameras.push(this.rig.camera(place));
    }
    return this.samples.length === 1 ? [first.camera] : [first.camera, ...cameras, last.camera];
  }
}
