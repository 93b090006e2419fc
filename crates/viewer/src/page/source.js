// Where photos and depth come from: from within the page, or from the server that sent it. Of a scene of photos the time step is always 0.

const scene = JSON.parse(document.getElementById("scene").textContent);
const token = new URLSearchParams(location.search).get("token");
const bytesOf = (base64) => Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));

const address = (path) => (token ? `${path}${path.includes("?") ? "&" : "?"}token=${encodeURIComponent(token)}` : path);

async function fetched(path, options) {
  const answer = await fetch(address(path), options);
  if (!answer.ok) throw Object.assign(new Error((await answer.text()).trim() || `status ${answer.status}`), { again: answer.status === 503 });
  return answer;
}

const photoUrl = ({ view, step }) => (scene.served ? address(`photo/${view}?step=${step}`) : `data:image/jpeg;base64,${scene.views[view].photo}`);
const depthOf = async ({ view, step }) => (scene.served ? new Uint8Array(await (await fetched(`depth/${view}?step=${step}`)).arrayBuffer()) : bytesOf(scene.views[view].depth));

// Photos that stay in memory; those far from the viewpoint, and of other time steps, are dropped first.
const MOST_LOADED = 120;
// Requests at a time.
const LOADERS = scene.served ? 4 : 1;
const pause = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));

class Photos {
  // `changed()`: called when a photo or a depth has come; `failed(text)`.
  constructor(views, changed, failed) {
    Object.assign(this, { views, changed, failed, photos: new Map(), wanted: [] });
    for (let i = 0; i < LOADERS; i += 1) this.load(i);
  }

  // The photo of a view at a time step, loaded or not.
  get(view, step = 0) {
    const key = `${view} ${step}`;
    if (!this.photos.has(key)) {
      const { camera, skew, pose, held_out } = this.views[view];
      this.photos.set(key, { view, step, camera: { ...camera, skew }, pose, gains: new Map(), state: "none", hasDepth: !held_out });
    }
    return this.photos.get(key);
  }

  // Photos to load, the first ones first. `steps`: those of other time steps are never shown again.
  want(photos, free, steps) {
    this.wanted = photos.slice(0, MOST_LOADED);
    if (steps) this.photos.forEach((photo, key) => steps.includes(photo.step) || (free(photo), this.photos.delete(key)));
    const loaded = [...this.photos.values()].filter((photo) => photo.bitmap);
    for (const photo of loaded.filter((photo) => !this.wanted.includes(photo)).slice(0, Math.max(0, loaded.length - MOST_LOADED))) {
      if (!scene.served) continue;
      free(photo);
      this.photos.delete(`${photo.view} ${photo.step}`);
    }
  }

  // The photos that a photo's sharpness is compared with.
  around({ view, step }) {
    const { pose } = this.views[view];
    this.views[view].around ??= this.views.filter((other) => !other.held_out && other.index !== view && dot(other.pose.rotation[2], pose.rotation[2]) > 0.5)
      .sort((a, b) => distance(a.pose.centre, pose.centre) - distance(b.pose.centre, pose.centre)).slice(0, 3).map(({ index }) => index);
    return this.views[view].around.map((other) => this.get(other, step));
  }

  // Measures how sharp a photo is, once all depth that this takes is there.
  measure(photo) {
    const around = this.around(photo);
    if (photo.sharpness !== undefined || !photo.depth || around.some(({ depth, hasDepth }) => hasDepth && !depth)) return;
    photo.sharpness = sharpness(photo, around.filter(({ depth }) => depth));
  }

  next(loader) {
    const photo = this.wanted.find((photo) => photo.state === "none");
    if (photo) return photo;
    // One loader is left for photos: those that wait for depth may wait long.
    if (LOADERS > 1 && loader === 0) return undefined;
    return this.wanted.find((photo) => photo.state === "photo" && photo.hasDepth);
  }

  async load(loader) {
    for (;;) {
      const photo = this.next(loader);
      if (!photo) {
        await pause(30);
        continue;
      }
      const before = photo.state;
      photo.state = "loading";
      try {
        if (before === "none") {
          Object.assign(photo, await loadPhoto(photoUrl(photo)));
          this.views[photo.view].thumbnail ??= photo.thumbnail;
          photo.state = "photo";
        } else {
          const { w, h } = photo.camera;
          const depth = await decodeDepth(await depthOf(photo), w, h);
          photo.depth = depth;
          photo.state = "depth";
          for (const near of [photo, ...this.around(photo)]) this.measure(near);
        }
        this.changed(photo);
      } catch (error) {
        photo.state = error.again || error instanceof TypeError ? before : "failed";
        photo.hasDepth = false;
        if (photo.state !== "failed") {
          photo.hasDepth = true;
          await pause(1000);
        }
        this.failed(`${this.views[photo.view].name}: ${error.message}`);
      }
      // The page draws in between.
      await pause(0);
    }
  }
}
