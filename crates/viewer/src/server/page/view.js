// The page: the viewpoint, requests for pictures, and the picture shown.

import { listen } from "./input.js";
import { Link, address } from "./link.js";
import { Panel } from "./panel.js";
import { Player } from "./player.js";
import { Recorder } from "./recorder.js";
import { Rig, centreOf } from "./rig.js";

// Milliseconds without a movement after which a picture at full quality is requested; while a pointer is pressed the next movement,
// which would wait for that picture, is likely.
const REST_DELAY = 200;
const PRESSED_REST_DELAY = 600;
const element = (id) => document.getElementById(id);
const picture = element("picture");
const panel = new Panel();
const player = new Player(requestMoving);
const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

let views = [];
let rig;
// The rig around the view at which the session starts.
let startRig;
// The viewpoint before soft limits are applied; and the camera of a photo, if the viewpoint is exactly there.
let place = { u: 0, v: 0, z: 0, yaw: 0, pitch: 0 };
let photoCamera;
// Mean disparity of the last picture, 1/scene unit.
let disparity;
let restTimer;
let isPressed = () => false;
// Requested cameras, by the number of the request.
const requested = new Map();
// The path that is being recorded.
let path;
// The camera of the picture shown.
let shown;

const link = new Link({
  session(info) {
    const isFirst = !rig;
    views = info.views.map((view) => ({ ...view, centre: centreOf(view.camera) }));
    if (isFirst) start(info);
    panel.session(info);
    player.session(info.video);
    panel.message();
    listHeldOut();
    request(player.playing);
  },
  picture: show,
  search: (progress) => panel.search(progress),
  error: (text) => panel.message(text),
  lost: (reason) => {
    panel.message(reason ? `Closed: ${reason}. Trying again …` : "The connection is lost. Trying again …");
    picture.dataset.quality = "lost";
  },
});

function start(info) {
  const { w, h } = views[info.start_view].camera;
  document.documentElement.style.setProperty("--aspect", w / h);
  [picture.width, picture.height] = [w, h];
  startRig = rig = new Rig(views, info.start_view, info.near);
  disparity = 1 / info.near;
  isPressed = listen(picture, move, () => restTimer && restAfter(REST_DELAY));
}

const currentCamera = () => photoCamera ?? rig.camera(rig.bounded(place));

function request(moving) {
  const camera = currentCamera();
  const id = link.request({ camera, step: player.step, moving, depth: element("depth").checked });
  requested.set(id, camera);
  record(camera);
  if (requested.size > 200) requested.delete(requested.keys().next().value);
}

// Adds the viewpoint to the path that is being recorded, if it has changed.
function record(camera) {
  if (!path || same(path.samples[path.samples.length - 1].camera, camera)) return;
  path.add(camera);
  element("record").textContent = `Stop (${path.seconds.toFixed(1)} s)`;
}

// Moves the viewpoint: shares of the picture's width, and of the depth in view (`ahead`).
function move({ right = 0, down = 0, ahead = 0, yaw = 0, pitch = 0 }) {
  if (!rig) return;
  if (photoCamera) place = rig.viewpoint(photoCamera);
  photoCamera = undefined;
  const { w, fl_x } = rig.templateCamera;
  const depth = 1 / Math.max(disparity, 1e-9);
  place.u += (right * w * depth) / fl_x;
  place.v += (down * w * depth) / fl_x;
  place.z += ahead * depth;
  place.yaw += (yaw * w) / fl_x;
  place.pitch += (pitch * w) / fl_x;
  place = rig.within(place);
  requestMoving();
}

// Requests a picture of a changed viewpoint or time step, and one at full quality once nothing changes and no video plays.
function requestMoving() {
  request(true);
  restAfter(isPressed() ? PRESSED_REST_DELAY : REST_DELAY);
}

function restAfter(delay) {
  clearTimeout(restTimer);
  restTimer = setTimeout(() => {
    restTimer = undefined;
    if (!player.playing) request(false);
  }, delay);
}

// Puts the viewpoint at a photo.
function goToPhoto(view) {
  clearTimeout(restTimer);
  restTimer = undefined;
  photoCamera = views[view].camera;
  rig = new Rig(views, view, 1 / disparity);
  place = rig.viewpoint(photoCamera);
  request(player.playing);
}

function show(header, bitmap) {
  const camera = requested.get(header.id);
  if (camera && (camera.w !== picture.width || camera.h !== picture.height)) {
    [picture.width, picture.height] = [camera.w, camera.h];
    document.documentElement.style.setProperty("--aspect", camera.w / camera.h);
  }
  picture.getContext("2d").drawImage(bitmap, 0, 0, picture.width, picture.height);
  disparity = header.disparity > 0 ? header.disparity : disparity;
  if (camera) {
    shown = camera;
  }
  panel.message(header.left_out.length > 0 ? `Left out: ${header.left_out.join("; ")}` : header.warning);
  panel.picture(header, views, rig, rig.viewpoint(shown ?? currentCamera()));
  showPhoto(header);
  picture.dataset.quality = header.moving ? "moving" : header.search ? "draft" : "rest";
  picture.dataset.frame = header.id;
  picture.dataset.step = header.step;
}

function showPhoto({ views: [view], step, moving }) {
  const beside = element("side").checked;
  element("beside").hidden = !beside;
  const { dataset } = element("photo");
  // While a video plays the photo is not updated, so that the picture has all the time.
  if (!beside || view === undefined || (dataset.view === String(view) && (moving || dataset.step === String(step)))) return;
  [dataset.view, dataset.step] = [view, step];
  element("photo").src = address(`photo/${view}?step=${step}`);
  element("photo_name").textContent = views[view].name;
}

function listHeldOut() {
  const buttons = views.flatMap((view, i) => {
    if (!view.held_out) return [];
    const button = document.createElement("button");
    button.textContent = view.name;
    button.title = "Go to the pose of this held-out photo";
    button.onclick = () => goToPhoto(i);
    return [button];
  });
  element("held_out").replaceChildren(...buttons);
  element("held_out").hidden = buttons.length === 0;
}

function download(blob, name) {
  const anchor = document.createElement("a");
  anchor.href = URL.createObjectURL(blob);
  anchor.download = name;
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(anchor.href), 1000);
}

element("depth").onchange = () => request(player.playing);
element("side").onchange = () => request(player.playing);
element("home").onclick = () => {
  [rig, photoCamera, place] = [startRig, undefined, { u: 0, v: 0, z: 0, yaw: 0, pitch: 0 }];
  request(player.playing);
};
element("map").onclick = (event) => {
  const view = panel.viewAt(event.offsetX, event.offsetY);
  if (view !== undefined) goToPhoto(view);
};
element("map").onkeydown = (event) => {
  const direction = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  if (!direction) return;
  event.preventDefault();
  const view = panel.viewTowards(direction);
  if (view !== undefined) goToPhoto(view);
};
element("save").onclick = async () => {
  const answer = await fetch(address("picture"), { method: "POST", body: JSON.stringify({ camera: currentCamera(), step: player.step }) }).catch(() => undefined);
  if (answer?.ok) download(await answer.blob(), "picture.png");
  else panel.message(`The picture was not saved: ${answer ? await answer.text() : "no connection"}`);
};
element("record").onclick = () => {
  if (path) download(new Blob([JSON.stringify(path.cameras(), null, 1)], { type: "application/json" }), "path.json");
  path = path ? undefined : new Recorder(rig, currentCamera());
  element("record").textContent = path ? "Stop (0.0 s)" : "Record path";
  element("record").setAttribute("aria-pressed", String(Boolean(path)));
};
