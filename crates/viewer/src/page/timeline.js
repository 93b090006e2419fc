// Keyframes on a time line: played, saved as cameras for `liveview render --path`, or recorded as a video.

// Cameras per second of a saved path.
const PATH_RATE = 30;

class TimeLine {
  // `seconds` between keyframes; `changed()`: called when there is another number of keyframes.
  constructor(changed) {
    Object.assign(this, { keys: [], seconds: 2, changed });
  }

  get length() {
    return Math.max(0, this.keys.length - 1) * this.seconds;
  }

  set(keys) {
    this.keys = keys;
    this.changed();
  }

  // The camera at a time, seconds: centres on a Catmull-Rom curve through those of the keyframes.
  at(time) {
    const place = clamp(time / this.seconds, 0, this.keys.length - 1);
    const i = Math.min(Math.floor(place), this.keys.length - 2);
    if (i < 0) return this.keys[0];
    const share = place - i;
    const key = (k) => this.keys[clamp(k, 0, this.keys.length - 1)];
    const [before, from, to, after] = [i - 1, i, i + 1, i + 2].map((k) => poseOf(key(k)));
    const { rotation } = between(from, to, share);
    const centre = from.centre.map((_, c) => {
      const [p0, p1, p2, p3] = [before, from, to, after].map((pose) => pose.centre[c]);
      return 0.5 * (2 * p1 + share * (p2 - p0 + share * (2 * p0 - 5 * p1 + 4 * p2 - p3 + share * (3 * p1 - p0 - 3 * p2 + p3))));
    });
    const mix = (name) => key(i)[name] + share * (key(i + 1)[name] - key(i)[name]);
    return cameraAt({ ...key(i), fl_x: mix("fl_x"), fl_y: mix("fl_y") }, { rotation, centre });
  }

  cameras() {
    const count = Math.max(1, Math.round(this.length * PATH_RATE) + 1);
    return Array.from({ length: count }, (_, i) => this.at(i / PATH_RATE));
  }
}

// Records a canvas until `stop` of what it returns is called, which gives the video.
function recordVideo(canvas) {
  const type = ["video/webm;codecs=vp9", "video/webm", "video/mp4"].find((kind) => globalThis.MediaRecorder?.isTypeSupported(kind));
  if (!type) throw new Error("this browser records no video");
  const recorder = new MediaRecorder(canvas.captureStream(), { mimeType: type, videoBitsPerSecond: 12e6 });
  const parts = [];
  recorder.ondataavailable = ({ data }) => parts.push(data);
  recorder.start();
  return {
    name: type.includes("webm") ? "video.webm" : "video.mp4",
    stop: () => new Promise((resolve) => {
      recorder.onstop = () => resolve(new Blob(parts, { type }));
      recorder.stop();
    }),
  };
}

function download(blob, name) {
  const anchor = document.createElement("a");
  anchor.href = URL.createObjectURL(blob);
  anchor.download = name;
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(anchor.href), 10_000);
}
