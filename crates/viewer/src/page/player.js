// The time steps of a rig: played at their pace, or the one that the slider is put to.

const element = (id) => document.getElementById(id);

export class Player {
  // `changed`: another step is to be shown, or time stands still.
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
  hello(video) {
    element("time").hidden = !video;
    if (!video) return;
    [this.steps, this.rate] = [video.steps, video.rate];
    this.step = Math.min(this.step, this.steps - 1);
    element("step").max = this.steps - 1;
    this.tell();
  }

  tell() {
    element("step").value = this.step;
    element("step_number").textContent = `${this.step + 1} / ${this.steps}`;
    element("play").textContent = this.playing ? "Pause" : "Play";
    element("play").setAttribute("aria-pressed", String(this.playing));
  }

  play(on) {
    this.playing = on;
    this.start();
    this.tell();
    this.changed();
    if (on) requestAnimationFrame((now) => this.tick(now));
  }

  // From the step there is.
  start() {
    this.begun = performance.now() - (1000 * this.step) / this.rate;
  }

  // Steps that a picture comes too late for are passed over.
  tick(now) {
    if (!this.playing) return;
    requestAnimationFrame((next) => this.tick(next));
    const step = Math.floor((Math.max(0, now - this.begun) / 1000) * this.rate) % this.steps;
    if (step === this.step) return;
    this.step = step;
    this.tell();
    this.changed();
  }

  scrub(step) {
    this.step = step;
    this.start();
    this.tell();
    this.changed();
  }
}
