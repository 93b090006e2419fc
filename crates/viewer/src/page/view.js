// The page: where the viewpoint is, what is wished for, what is shown.

import { listen } from "./input.js";
import { Link, address } from "./link.js";
import { Panel } from "./panel.js";
import { Player } from "./player.js";
import { Rig, centreOf } from "./rig.js";

// Milliseconds without a movement after which the viewpoint rests.
const REST = 80;
const element = (id) => document.getElementById(id);
const picture = element("picture");
const panel = new Panel();
const player = new Player(lookOn);
const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

let views = [];
let rig;
// The rig's neighbourhood that a viewer begins in.
let middle;
// The viewpoint as moved, before it is kept near the rig; and a camera that it stands on exactly.
let place = { u: 0, v: 0, z: 0, yaw: 0, pitch: 0 };
let standing;
// Of what the last picture shows: mean disparity, 1/scene unit.
let disparity;
let resting;
// Cameras that are wished for, by number; a path that is recorded.
const wished = new Map();
let path;
let shown;

const link = new Link({
  hello(told) {
    const before = rig;
    views = told.views.map((view) => ({ ...view, centre: centreOf(view.camera) }));
    if (!before) begin(told);
    panel.hello(told);
    player.hello(told.video);
    panel.message();
    listHeldOut();
    look(player.playing);
  },
  picture: show,
  refused: (text) => panel.message(text),
  lost: (reason) => {
    panel.message(reason ? `Closed: ${reason}. Trying again …` : "The connection is lost. Trying again …");
    picture.dataset.quality = "lost";
  },
});

function begin(told) {
  const { w, h } = views[told.middle].camera;
  document.documentElement.style.setProperty("--aspect", w / h);
  [picture.width, picture.height] = [w, h];
  middle = rig = new Rig(views, told.middle, told.near);
  disparity = 1 / told.near;
  listen(picture, move);
}

const cameraNow = () => standing ?? rig.camera(rig.bounded(place));

function look(moving) {
  const camera = cameraNow();
  const id = link.look({ camera, step: player.step, moving, depth: element("depth").checked });
  wished.set(id, camera);
  if (wished.size > 200) wished.delete(wished.keys().next().value);
}

// In shares of the picture's width, and in parts of the depth looked at.
function move({ right = 0, down = 0, ahead = 0, yaw = 0, pitch = 0 }) {
  if (!rig) return;
  if (standing) place = rig.viewpoint(standing);
  standing = undefined;
  const { w, fl_x } = rig.like;
  const depth = 1 / Math.max(disparity, 1e-9);
  place.u += (right * w * depth) / fl_x;
  place.v += (down * w * depth) / fl_x;
  place.z += ahead * depth;
  place.yaw += (yaw * w) / fl_x;
  place.pitch += (pitch * w) / fl_x;
  place = rig.within(place);
  lookOn();
}

// Another viewpoint or time step, perhaps not the last; while time runs nothing rests.
function lookOn() {
  look(true);
  clearTimeout(resting);
  resting = setTimeout(() => player.playing || look(false), REST);
}

function stand(view) {
  clearTimeout(resting);
  standing = views[view].camera;
  rig = new Rig(views, view, 1 / disparity);
  place = rig.viewpoint(standing);
  look(player.playing);
}

function show(header, bitmap) {
  const camera = wished.get(header.id);
  if (camera && (camera.w !== picture.width || camera.h !== picture.height)) {
    [picture.width, picture.height] = [camera.w, camera.h];
    document.documentElement.style.setProperty("--aspect", camera.w / camera.h);
  }
  picture.getContext("2d").drawImage(bitmap, 0, 0, picture.width, picture.height);
  disparity = header.disparity > 0 ? header.disparity : disparity;
  if (camera) {
    shown = camera;
    if (path && !same(path[path.length - 1], camera)) path.push(camera);
    element("record").textContent = path ? `Stop (${path.length})` : "Record path";
  }
  panel.message(header.left_out.length > 0 ? `Left out: ${header.left_out.join("; ")}` : undefined);
  panel.picture(header, views, rig, rig.viewpoint(shown ?? cameraNow()));
  showPhoto(header);
  picture.dataset.quality = header.moving ? "moving" : "rest";
  picture.dataset.frame = header.id;
  picture.dataset.step = header.step;
}

function showPhoto({ views: [view], step, moving }) {
  const beside = element("side").checked;
  element("beside").hidden = !beside;
  const { dataset } = element("photo");
  // While time runs the photo follows when it rests, so that the picture has all the time there is.
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
    button.title = "Stand on this held-out photo";
    button.onclick = () => stand(i);
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

element("depth").onchange = () => look(player.playing);
element("side").onchange = () => look(player.playing);
element("home").onclick = () => {
  [rig, standing, place] = [middle, undefined, { u: 0, v: 0, z: 0, yaw: 0, pitch: 0 }];
  look(player.playing);
};
element("map").onclick = (event) => {
  const view = panel.viewAt(event.offsetX, event.offsetY);
  if (view !== undefined) stand(view);
};
element("save").onclick = async () => {
  const answer = await fetch(address("picture"), { method: "POST", body: JSON.stringify({ camera: cameraNow(), step: player.step }) }).catch(() => undefined);
  if (answer?.ok) download(await answer.blob(), "picture.png");
  else panel.message(`The picture was not saved: ${answer ? await answer.text() : "no connection"}`);
};
element("record").onclick = () => {
  if (path) download(new Blob([JSON.stringify(path, null, 1)], { type: "application/json" }), "path.json");
  path = path ? undefined : [cameraNow()];
  element("record").textContent = path ? `Stop (${path.length})` : "Record path";
  element("record").setAttribute("aria-pressed", String(Boolean(path)));
};
