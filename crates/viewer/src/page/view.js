// The page: where the viewpoint is, which photos are drawn, and the controls.

const element = (id) => document.getElementById(id);
const [canvas, frame] = [element("picture"), element("frame")];
const views = scene.views.map((view, index) => ({ ...view, index, photo: undefined, depth: undefined, pose: poseOf(view.camera) }));
const free = views.filter((view) => !view.held_out).map((view) => view.index);
const video = scene.served?.video;
// How a view is drawn while it moves, the slower the machine the less: share of the sides, and of the pixels of depth one of so many across and down.
const LEVELS = [[1, 1], [1, 2], [0.7, 2], [0.5, 2], [0.35, 4], [0.25, 4], [0.18, 6], [0.14, 8]];
// Milliseconds of a frame above which the level goes up, and below which it comes down.
const [SLOW, FAST] = [60, 18];
// Milliseconds until a photo has faded in, until a flight arrives, and without movement until all is drawn.
const [FADE, FLIGHT, REST] = [150, 700, 180];

let camera = { ...views[scene.start].camera }; // where the viewpoint is
let baseFocal = camera.fl_x;
let at = scene.start; // the photo that it is exactly at, if it is
let slots = []; // { photo, weight, target }
let [level, fastFrames, slowFrames] = [1, 0, 0];
let [flight, run, recording] = [undefined, undefined, undefined];
let [pressed, movedAt, pivot] = [false, -Infinity, undefined];
let searching = true; // until the depth of the nearest photos is there: the same machine may search for it
let [drawn, frames, fence, needed, resting] = [0, [], undefined, true, false];
// Of cameras that run, the server says which time step is the last.
const isLive = video?.steps === null;
let [step, shownStep, playing, playedFrom, asking] = isLive ? [-1, -1, true, 0] : [0, 0, false, 0];
let drawer;
const timeLine = new TimeLine(showKeys);
const photos = new Photos(views, arrived, (text) => isLive || message(`Left out: ${text}`));
const map = new RigMap(element("map"), views, goTo);

// What stays as it was costs no layout.
function put(id, text) {
  if (element(id).textContent !== text) element(id).textContent = text;
}
function setLength(name, value) {
  const { style } = document.documentElement;
  if (style.getPropertyValue(name) !== value) style.setProperty(name, value);
}

function message(text) {
  element("message").hidden = !text;
  element("message").textContent = text ?? "";
}

// The distance from photo to photo, and how far beyond the photos a camera is: 0 near them, 1 where little of what it sees is known.
const spacing = median(free.map((a) => Math.min(...free.filter((b) => b !== a).map((b) => distance(views[a].pose.centre, views[b].pose.centre)), Infinity)));
function beyond(pose) {
  const nearest = views[nearestFree(pose)[0]].pose;
  const far = distance(nearest.centre, pose.centre) / Math.max(Number.isFinite(spacing) ? spacing : scene.near, 1e-9);
  const angle = Math.acos(clamp(dot(nearest.rotation[2], pose.rotation[2]), -1, 1));
  return { far, share: clamp(Math.max((far - 2) / 6, (angle - 0.7) / 0.8), 0, 1) };
}

const nearestTo = (pose) => [...views].sort((a, b) => distance(a.pose.centre, pose.centre) - distance(b.pose.centre, pose.centre)).map(({ index }) => index);
const nearestFree = (pose) => nearestTo(pose).filter((view) => !views[view].held_out);

function place(next, exactly) {
  [camera, at, movedAt, needed, resting] = [next, exactly, performance.now(), true, false];
}

// Flies to the pose of a photo, and takes its field of view.
function goTo(view) {
  run = undefined;
  element("photo_list").value = view;
  flight = { from: camera, to: views[view].camera, view, begun: performance.now() };
  [needed, resting] = [true, false];
}

const moved = (pose) => place(cameraAt(camera, pose), undefined);
const ahead = () => (pivot ??= drawer?.middleDepth() ?? focus(poseOf(camera), free.map((view) => views[view].pose), 4 * scene.near));
listen(canvas, {
  begin() {
    [pressed, pivot, flight, run] = [true, undefined, undefined, undefined];
    ahead();
  },
  end() {
    pressed = false;
  },
  orbit(dx, dy) {
    const { rotation, centre } = poseOf(camera);
    const middle = add(centre, rotation[2], ahead());
    // A drag over the whole width goes as far as the photos do, half a turn at most.
    const speed = clamp((3 * map.extent) / ahead(), 0.4, 3);
    const turned = product(turn(rotation[0], -speed * dy), turn(map.down, speed * dx));
    moved({ rotation: product(rotation, transposed(turned)), centre: add(middle, times(turned, add(centre, middle, -1))) });
  },
  pan(dx, dy) {
    const { rotation, centre } = poseOf(camera);
    const scale = (-ahead() * camera.w) / camera.fl_x;
    moved({ rotation, centre: add(add(centre, rotation[0], scale * dx), rotation[1], scale * dy) });
  },
  dolly(share) {
    const { rotation, centre } = poseOf(camera);
    moved({ rotation, centre: add(centre, rotation[2], share * ahead()) });
    pivot = Math.max(pivot * (1 - share), 0.02 * scene.near);
  },
});

// The size at which the picture is drawn at rest.
function size() {
  if (element("exact").checked) return [camera.w, camera.h];
  const w = Math.max(16, Math.min(canvas.clientWidth * Math.min(devicePixelRatio, 2), 1.25 * Math.max(camera.w, 640), drawer.gl.getParameter(drawer.gl.MAX_TEXTURE_SIZE)));
  return [Math.round(w), Math.max(1, Math.round((w * camera.h) / camera.w))];
}

// Photos fade in and out one at a time, so that sets change smoothly; all at once where `jump`, or where a fifth photo takes too long.
function chooseSlots(now, elapsed, jump) {
  const candidates = free.filter((view) => photos.get(view, shownStep).bitmap && view !== (views[at]?.held_out ? at : -1));
  if (candidates.length === 0) return false;
  const kept = jump || now - movedAt > REST ? [] : slots.map(({ photo }) => photo.view);
  const chosen = choose(views, candidates, camera, 4, kept).map((view) => photos.get(view, shownStep));
  if (jump || level > 5 || slots.length === 0 || slots.some(({ photo }) => photo.step !== shownStep)) slots = chosen.map((photo) => ({ photo, weight: 1 }));
  const missing = chosen.filter((photo) => !slots.some((slot) => slot.photo === photo));
  const fading = slots.some((slot) => slot.weight < 1);
  if (missing.length > 0 && !fading && slots.length < SLOTS) slots.push({ photo: missing[0], weight: 0 });
  const incoming = slots.some((slot) => slot.weight < 1 && chosen.includes(slot.photo));
  const outgoing = slots.filter((slot) => !chosen.includes(slot.photo));
  const leaving = outgoing.find((slot) => slot.weight < 1) ?? (incoming || missing.length === 0 || slots.length >= SLOTS ? outgoing[0] : undefined);
  for (const slot of slots) slot.weight = clamp(slot.weight + ((slot === leaving ? -1 : 1) * elapsed) / FADE, 0, 1);
  slots = slots.filter((slot) => slot !== leaving || slot.weight > 0);
  const pose = poseOf(camera);
  slots.sort((a, b) => distance(a.photo.pose.centre, pose.centre) - distance(b.photo.pose.centre, pose.centre));
  return slots.some((slot) => slot.weight < 1) || slots.length !== chosen.length;
}

// Two more photos, whose depth helps.
function helpers() {
  const known = free.filter((view) => photos.get(view, shownStep).depth);
  return choose(views, known, camera, 6).map((view) => photos.get(view, shownStep)).filter((photo) => !slots.some((slot) => slot.photo === photo)).slice(0, 2);
}

function present() {
  const { share } = beyond(poseOf(camera));
  const truth = views[at]?.held_out ? photos.get(at, shownStep) : undefined;
  const ground = getComputedStyle(document.body).backgroundColor.match(/\d+/g).slice(0, 3).map((value) => value / 255);
  const options = { depth: element("depth").checked, guessed: element("guessed").checked, fade: 0.85 * share, ground };
  drawer.present({ ...options, ...(truth?.bitmap ? { photo: truth, wipe: Number(element("wipe").value) } : {}) });
}

// `photo`: one to show as it is.
function draw(full, photo) {
  const [w, h] = size();
  // Time steps come slower than frames of a movement: a slow machine has time for some more pixels.
  const [scale, stride] = LEVELS[full ? 0 : playing && !pressed ? Math.min(level, 4) : level];
  const small = [w, h].map((side) => Math.max(8, Math.round(scale * side)));
  const shown = photo || recording ? [w, h] : small; // the browser enlarges it faster
  if (canvas.width !== shown[0] || canvas.height !== shown[1]) [canvas.width, canvas.height] = shown;
  if (photo) return drawer.present({ photo, wipe: 2 });
  drawer.draw(resized(camera, ...small), slots, { near: scene.near, far: scene.far, stride, three: full, helpers: full ? helpers() : [] });
  present();
}

// What the next frames need takes the time of several: it is made at rest, one thing at a time.
function prepareNext() {
  const near = nearestFree(poseOf(camera)).slice(0, 8).map((view) => photos.get(view, shownStep));
  const next = near.find((photo) => (photo.bitmap && !photo.texture) || (photo.depth && !photo.code));
  if (next) return drawer.upload(next);
  const isNew = (photo, other) => photo !== other && photo.depth && other.depth && !photo.gains.has(other);
  const other = near.slice(0, 4).find((other) => near.some((photo) => isNew(photo, other)));
  if (other) relativeTo(near.find((photo) => isNew(photo, other)), other);
}

// One frame is drawn at a time: the next begins when the last is finished.
let [last, begun] = [performance.now(), 0];
function tick(now) {
  requestAnimationFrame(tick);
  if (!drawer) return;
  if (fence) {
    const { gl } = drawer;
    const state = gl.clientWaitSync(fence, gl.SYNC_FLUSH_COMMANDS_BIT, 0);
    if (state === gl.TIMEOUT_EXPIRED) return;
    gl.deleteSync(fence);
    fence = undefined;
    finished(performance.now());
  }
  const elapsed = Math.min(now - last, 100);
  last = now;
  // Nothing fades before the first picture.
  let jump = drawn < 2;
  if (flight) {
    const share = clamp((now - flight.begun) / FLIGHT, 0, 1);
    const eased = share * share * (3 - 2 * share);
    const to = flight.to;
    const mixed = { ...to, fl_x: camera.fl_x + (to.fl_x - camera.fl_x) * eased, fl_y: camera.fl_y + (to.fl_y - camera.fl_y) * eased };
    place(share < 1 ? cameraAt(mixed, between(poseOf(flight.from), poseOf(to), eased)) : { ...to }, share < 1 ? undefined : flight.view);
    if (share >= 1) {
      [flight, baseFocal, jump] = [undefined, to.fl_x, true];
      element("view").value = 0;
    }
  } else if (run !== undefined) {
    const time = (now - run) / 1000;
    place({ ...timeLine.at(Math.min(time, timeLine.length)) }, undefined);
    element("clock").value = time;
    if (time >= timeLine.length) stopRun();
  }
  playStep(now);
  if (resting && !needed) {
    prepareNext();
    return;
  }
  const changing = chooseSlots(now, elapsed, jump);
  if (slots.length === 0) return;
  const moving = pressed || flight || run !== undefined || playing || now - movedAt < REST;
  const full = !moving && !changing && !searching;
  if (!(needed || changing || full)) return;
  begun = performance.now();
  // First the photo at the start: a slow machine takes a second to prepare all other passes.
  const first = drawn === 0 && slots[0].photo.view === at ? slots[0].photo : undefined;
  draw(full, first);
  fence = drawer.gl.fenceSync(drawer.gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  [needed, resting] = [Boolean(first), full && !first];
  wantPhotos();
  if (!full) hideFull();
}

function finished(now) {
  const took = now - begun;
  drawn += 1;
  frames.push({ now, took, full: resting });
  frames = frames.slice(-600);
  if (!resting) {
    // A single slow frame, in which photos were put into textures, changes nothing; two, or a very slow one, lead to the level at which such a frame
    // is fast enough.
    const isSlow = took > SLOW && drawn > 3;
    [fastFrames, slowFrames] = [took < FAST ? fastFrames + 1 : 0, isSlow ? slowFrames + 1 : 0];
    if (slowFrames > 1 || (isSlow && took > 4 * SLOW)) {
      const fits = LEVELS.findIndex(([scale], next) => next > level && scale ** 2 * took < LEVELS[level][0] ** 2 * SLOW);
      [level, slowFrames] = [fits < 0 ? LEVELS.length - 1 : fits, 0];
    } else if (fastFrames > 40 && level > 0) [level, fastFrames] = [level - 1, 0];
  }
  canvas.dataset.quality = resting ? "rest" : "moving";
  canvas.dataset.frame = drawn;
  canvas.dataset.step = shownStep;
  showStatus();
}

// Loads the photos around the viewpoint, nearest first; of a rig also of the next time steps.
let wantedAt = -Infinity;
function wantPhotos() {
  const now = performance.now();
  if (now - wantedAt < 100) return;
  wantedAt = now;
  const near = nearestFree(poseOf(camera));
  if (step < 0) return;
  const held = views.filter((view) => view.held_out).map(({ index }) => photos.get(index, step));
  const steps = isLive || !video ? [step] : Array.from({ length: Math.min(video.steps, 24) }, (_, i) => (step + i) % video.steps);
  const wanted = steps.flatMap((time) => near.slice(0, video ? 4 : near.length).map((view) => photos.get(view, time)));
  photos.want([...wanted, ...held], (photo) => drawer.free(photo), isLive ? [step, shownStep] : undefined);
}

// The next time step is shown once its photos and their depth are there.
function playStep(now) {
  if (!video) return;
  if (isLive) wantPhotos();
  const isReady = (time) => {
    const near = nearestFree(poseOf(camera)).slice(0, 4);
    return near.map((view) => photos.get(view, time)).every((photo) => photo.state === "depth" || photo.state === "failed" || (photo.bitmap && !playing && time === step));
  };
  if (playing && shownStep === step) {
    const due = isLive ? 0 : Math.floor(((now - playedFrom) / 1000) * video.rate);
    if (isLive) asking ??= fetched("moment").then((answer) => answer.json(), () => pause(1000).then(() => step)).then((last) => [asking, step, wantedAt] = [undefined, last, -Infinity]);
    if (due > 0) {
      [step, playedFrom] = [(step + due) % video.steps, playedFrom + (1000 * due) / video.rate];
      for (let back = 0; back < due - 1 && !isReady(step); back += 1) step = (step + video.steps - 1) % video.steps;
      showStep();
      wantedAt = -Infinity;
      wantPhotos();
    }
  }
  if (shownStep !== step && isReady(step)) {
    [shownStep, needed, playedFrom] = [step, true, now];
    showStep();
  }
}

function showStep() {
  element("step").value = step;
  element("step_number").textContent = isLive ? (playing ? "live" : "") : `${step + 1} / ${video.steps}${shownStep === step ? "" : " …"}`;
  element("play").textContent = playing ? "Pause" : "Play";
  element("play").setAttribute("aria-pressed", String(playing));
}

function arrived(photo) {
  // Depth that was not known before changes the picture at rest too.
  if (slots.length < 4 || slots.some((slot) => slot.photo === photo) || photo.view === at) [needed, resting] = [true, false];
  map.update(camera, slots.map(({ photo: { view } }) => view));
  if (!drawer && photo.bitmap && !photo.depth) element("photos").append(photo.thumbnail);
  showStatus();
}

function showStatus() {
  const { far, share } = beyond(poseOf(camera));
  const known = free.map((view) => photos.get(view, shownStep));
  const isFound = ({ state, hasDepth }) => state === "depth" || !hasDepth;
  const found = known.filter(isFound).length;
  searching = !video && !nearestFree(poseOf(camera)).slice(0, 8).every((view) => isFound(photos.get(view, shownStep)));
  const name = at === undefined ? "" : ` · at ${views[at].name}`;
  const progress = video || found === known.length ? "" : `depth of ${found} of ${known.length} photos`;
  const places = far < 2 ? "Turned away from the photos" : `${far.toFixed(0)} times as far as from photo to photo`;
  put("status", `${progress || `${known.length} ${video ? "cameras" : "photos"}`}${name}`);
  put("beyond", share < 0.05 ? progress : `${places}: ${share > 0.6 ? "most" : "some"} of this is guessed`);
  element("beyond").hidden = share < 0.05 && !progress;
  canvas.dataset.found = found;
  setLength("--aspect", `${camera.w / camera.h}`);
  setLength("--pixels", `${camera.w / devicePixelRatio}px`);
  put("degrees", `${((360 / Math.PI) * Math.atan(camera.w / 2 / camera.fl_x)).toFixed(0)}°`);
  const truth = views[at]?.held_out && photos.get(at, shownStep).state !== "failed";
  for (const id of ["wipe_row", "score"]) element(id).hidden = !truth;
  if (resting && truth) score();
  // A slow machine draws the picture alone while it moves.
  if (resting || level < 4) map.update(camera, slots.map(({ photo: { view } }) => view));
  if (element("details").parentElement.open) showDetails();
}

// PSNR of the picture against the held-out photo, at the photo's size.
let scored;
function score() {
  const truth = photos.get(at, shownStep);
  const key = `${at} ${shownStep} ${slots.map(({ photo }) => `${photo.view}${photo.state}`)}`;
  if (!truth.bitmap || scored === key) return;
  scored = key;
  const { w, h } = truth.camera;
  [canvas.width, canvas.height] = [w, h];
  drawer.draw(truth.camera, slots, { near: scene.near, far: scene.far, helpers: helpers() });
  drawer.present({});
  const shown = drawer.pixels();
  drawer.present({ photo: truth, wipe: 2 });
  const photo = drawer.pixels();
  let sum = 0;
  for (let i = 0; i < shown.length; i += 1) if (i % 4 < 3) sum += (shown[i] - photo[i]) ** 2;
  const psnr = 10 * Math.log10((255 * 255 * 3 * w * h) / sum);
  element("score").textContent = `${psnr.toFixed(2)} dB against ${views[at].name}, which is held out`;
  canvas.dataset.psnr = psnr;
  draw(true);
}

function showDetails() {
  const rows = {
    Picture: `${canvas.width} × ${canvas.height}`, "Drawn from": slots.map(({ photo }) => views[photo.view].name).join(", "),
    "Vertices a frame": drawer.vertices.toLocaleString("en"), "Texture reads a pixel": `at most ${READS}`,
    "While moving": `${Math.round(100 * LEVELS[level][0])} % of the sides`,
    ...(scene.served ? { "Full quality": `${scene.served.layers}, ${scene.served.engine}` } : {}),
  };
  element("details").replaceChildren(...Object.entries(rows).flatMap(([name, value]) => {
    const [term, text] = [document.createElement("dt"), document.createElement("dd")];
    [term.textContent, text.textContent] = [name, value];
    return [term, text];
  }));
  const plot = element("times");
  [plot.width, plot.height] = [plot.clientWidth, plot.clientHeight];
  const context = plot.getContext("2d");
  const recent = frames.slice(-80);
  const most = Math.max(40, ...recent.map(({ took }) => took));
  recent.forEach(({ took, full }, i) => {
    context.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(full ? "--warm" : "--accent");
    context.fillRect((i * plot.width) / 80, plot.height * (1 - took / most), plot.width / 80 - 1, (plot.height * took) / most);
  });
}

// The picture at full quality lies over the drawn one until something moves.
let fullBlob;
function hideFull() {
  if (!fullBlob) return;
  URL.revokeObjectURL(element("full").src);
  element("full").classList.remove("shown");
  [element("full").hidden, fullBlob] = [true, undefined];
}
async function renderFull() {
  const asked = camera;
  element("quality").disabled = true;
  try {
    const body = JSON.stringify({ camera, step: shownStep });
    const blob = await (await fetched("picture", { method: "POST", body })).blob();
    if (asked !== camera) return;
    const image = element("full");
    image.src = URL.createObjectURL(blob);
    await image.decode();
    [fullBlob, image.hidden] = [blob, false];
    requestAnimationFrame(() => image.classList.add("shown"));
    message();
  } catch (error) {
    message(`Full quality: ${error.message}`);
  } finally {
    element("quality").disabled = false;
  }
}

function showKeys() {
  const count = timeLine.keys.length;
  element("keys").textContent = count ? `${count} ${count === 1 ? "keyframe" : "keyframes"}, ${timeLine.length.toFixed(0)} s` : "no keyframes";
  element("clock").max = timeLine.length;
  for (const id of ["run", "clear", "path", "video", "clock"]) element(id).disabled = count < (id === "clear" || id === "path" ? 1 : 2);
}
async function stopRun() {
  run = undefined;
  element("run").textContent = "Play";
  if (!recording) return;
  const { name, stop } = recording;
  recording = undefined;
  element("video").setAttribute("aria-pressed", "false");
  download(await stop(), name);
}
function startRun() {
  flight = undefined;
  run = performance.now() - (Number(element("clock").value) < timeLine.length - 0.05 ? 1000 * Number(element("clock").value) : 0);
  element("run").textContent = "Stop";
}

element("nearest").onclick = () => goTo(nearestFree(poseOf(camera))[0]);
element("screen").onclick = () => (document.fullscreenElement ? document.exitFullscreen() : element("stage").requestFullscreen?.());
element("save").onclick = () => (fullBlob ? download(fullBlob, "picture.png") : canvas.toBlob((blob) => download(blob, "picture.png")));
element("quality").onclick = renderFull;
element("exact").onchange = () => frame.classList.toggle("exact", element("exact").checked);
for (const id of ["depth", "guessed", "exact"]) element(id).addEventListener("change", () => [needed, resting] = [true, false]);
element("wipe").oninput = () => !fence && drawer?.targets && present();
element("view").oninput = () => {
  const focal = baseFocal * 2 ** -Number(element("view").value);
  place({ ...camera, fl_x: focal, fl_y: (focal * camera.fl_y) / camera.fl_x }, undefined);
};
element("photo_list").onchange = () => goTo(Number(element("photo_list").value));
element("key").onclick = () => timeLine.set([...timeLine.keys, { ...camera }]);
element("run").onclick = () => (run === undefined ? startRun() : stopRun());
element("clear").onclick = () => timeLine.set([]);
element("clock").oninput = () => {
  [run, flight] = [undefined, undefined];
  place({ ...timeLine.at(Number(element("clock").value)) }, undefined);
};
element("path").onclick = () => {
  download(new Blob([JSON.stringify(timeLine.cameras(), null, 1)], { type: "application/json" }), "path.json");
};
element("video").onclick = () => {
  try {
    recording = recordVideo(canvas);
    element("video").setAttribute("aria-pressed", "true");
    element("clock").value = 0;
    startRun();
  } catch (error) {
    message(error.message);
  }
};
element("play").onclick = () => {
  [playing, playedFrom] = [!playing, performance.now()];
  showStep();
};
element("step").oninput = () => {
  step = Number(element("step").value);
  [playing, needed, wantedAt] = [false, true, -Infinity];
  showStep();
};
addEventListener("keydown", (event) => {
  if (event.target.closest?.("input, select, button, summary") || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === "h" || event.key === "H") element("nearest").click();
  else if (event.key === " " && video) element("play").click();
  else return;
  event.preventDefault();
});
addEventListener("resize", () => [needed, resting] = [true, false]);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => [needed, resting] = [true, false]);
canvas.addEventListener("webglcontextlost", () => message("The graphics processor was lost: reload the page."));

document.title = `${scene.scene} · LiveView`;
element("name").textContent = scene.scene;
element("quality").hidden = !scene.served;
element("photo_list").replaceChildren(...views.map((view) => {
  const option = document.createElement("option");
  [option.value, option.textContent] = [view.index, view.held_out ? `${view.name} (held out)` : view.name];
  return option;
}));
element("photo_list").value = scene.start;
if (video) {
  element("time").hidden = false;
  [element("step").hidden, element("step").max] = [isLive, video.steps - 1];
  showStep();
}
try {
  drawer = new Drawer(canvas);
} catch (error) {
  message(`This browser cannot draw the scene (${error.message}): these are its photos.`);
  element("photos").hidden = false;
}
wantPhotos();
showStatus();
requestAnimationFrame(tick);
// For tests, and for pages that hold this one.
window.liveview = {
  get state() {
    return { camera, at, slots: slots.map(({ photo, weight }) => ({ view: photo.view, weight })), frames, level, resting, vertices: drawer?.vertices, step: shownStep };
  },
  go: (next) => place(next, undefined),
  pixels: () => drawer.pixels(),
};
