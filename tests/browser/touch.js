// Fingers on a phone's screen.

import assert from "node:assert/strict";

import { atRest, pixels, saved, sleep, state, text, until } from "./page.js";

// Moves fingers from their first places to their last; each is [x, y] in shares of the canvas.
async function fingers(page, from, to) {
  const box = await (await page.$("#picture")).boundingBox();
  const session = await page.createCDPSession();
  const at = (part) => from.map(([x, y], id) => ({
    id, x: box.x + box.width * (x + part * (to[id][0] - x)), y: box.y + box.height * (y + part * (to[id][1] - y)),
  }));
  const send = (type, touchPoints) => session.send("Input.dispatchTouchEvent", { type, touchPoints });
  await send("touchStart", at(0));
  for (let i = 1; i <= 20; i += 1) {
    await send("touchMove", at(i / 20));
    await sleep(16);
  }
  await send("touchEnd", []);
}

const rotation = (camera) => camera.cam_from_world.map((row) => row.slice(0, 3));
const centre = (camera) => [0, 1, 2].map((i) => -camera.cam_from_world.reduce((sum, row) => sum + row[i] * row[3], 0));
// How far the viewpoint has gone, right, down and forward in its first axes, and by how much it has turned to the right.
function moved([first, ...rest]) {
  const last = rest[rest.length - 1];
  const way = centre(last).map((x, i) => x - centre(first)[i]);
  const [right, down, ahead] = rotation(first).map((axis) => axis.reduce((sum, x, i) => sum + x * way[i], 0));
  const turned = rotation(first)[0].reduce((sum, x, i) => sum + x * rotation(last)[2][i], 0);
  return { right, down, ahead, turned };
}

export async function testTouch(page, passed) {
  await atRest(page);
  const frame = async () => (await state(page)).frame;
  const another = (what, before) => until(what, async () => (await frame()) !== before && (await state(page)).quality === "rest");
  const gesture = async (from, to) => {
    const last = await frame();
    await page.evaluate(() => document.getElementById("home").click());
    await another("the picture in the middle", last);
    const before = [await frame(), (await pixels(page)).hash];
    await page.evaluate(() => document.getElementById("record").click());
    await fingers(page, from, to);
    await another("another picture at rest", before[0]);
    await until("a path of two cameras", async () => Number((await text(page, "record")).match(/[\d.]+/)) > 0);
    assert.notEqual((await pixels(page)).hash, before[1]);
    return moved(JSON.parse(await saved(page, "record", "path.json")));
  };
  const drag = await gesture([[0.6, 0.5]], [[0.4, 0.5]]);
  assert.ok(drag.right > 0 && Math.abs(drag.ahead) < drag.right, JSON.stringify(drag));
  const pinch = await gesture([[0.45, 0.5], [0.55, 0.5]], [[0.2, 0.5], [0.8, 0.5]]);
  assert.ok(pinch.ahead > 0 && Math.abs(pinch.right) < pinch.ahead, JSON.stringify(pinch));
  const turn = await gesture([[0.5, 0.4], [0.5, 0.6]], [[0.3, 0.4], [0.3, 0.6]]);
  assert.ok(turn.turned > 0.01 && Math.abs(turn.ahead) < 1e-3, JSON.stringify(turn));
  assert.equal(await page.evaluate(() => scrollY), 0, "the page does not scroll under a finger on the picture");
  passed("one finger drags, two pinch and turn");
}
