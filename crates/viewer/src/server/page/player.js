// The time steps of a rig: played at their rate, or set by the slider.

const element = (id) => document.getElementById(id);

export class Player {
  // `changed`: called when the step changes or playing stops.
  constructor(changed) {
    this.changed = changed;
    [this.steps, this.rate, this.step, this.playing] = [1, 1, 0, false];
    element("play").onclick = () => this.play(!this.playing);
    element("step").oninput = () => this.scrub(Number(element("step").value));
    addEventListener("keydown", (event) => {
      if (event.key !== " " || event.target.closest("button, input")) return;
      event.preventDefault();
      if (this.steps > 1) this.play(!this.playing);
    });
  }

  // `video`: steps and their rate per second; null for a scene.
  session(video) {
    element("time").hidden = !video;
    if (!video) return;
    [this.steps, this.rate] = [video.steps, video.rate];
    this.step = Math.min(this.step, this.steps - 1);
    element("step").max = this.steps - 1;
    this.update();
  }

  update() {
    element("step").value = this.step;
    element("step_number").textContent = `${this.step + 1} / ${this.steps}`;
    element("play").textContent = this.playing ? "Pause" : "Play";
    element("play").setAttribute("aria-pressed", String(this.playing));
  }

  play(on) {
    this.playing = on;
    this.start();
    this.update();
    this.changed();
    if (on) requestAnimationFrame((now) => this.tick(now));
  }

  // Sets the clock so that playing continues from the current step.
  start() {
    this.startedAt = performance.now() - (1000 * this.step) / this.rate;
  }

  // Steps for which a frame would be late are skipped.
  tick(now) {
    if (!this.playing) return;
    requestAnimationFrame((next) => this.tick(next));
    const step = Math.floor((Math.max(0, now - this.startedAt) / 1000) * this.rate) % this.steps;
    if (step === this.step) return;
    this.step = step;
    this.update();
    this.changed();
  }

  scrub(step) {
    this.step = step;
    this.start();
    this.update();
    this.changed();
  }
}
