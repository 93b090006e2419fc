// A rig's video: play, pause, scrub; what is saved is `liveview video`'s frame.

import assert from "node:assert/strict";
import { mkdirSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";

import { atRest, drag, pixels, saved, sleep, state, text, until } from "./page.js";
import { RIG, cpuSeconds, liveview, view } from "./program.js";

const STEPS = 18;

// Frames shown in so many milliseconds: when, and of which time step.
async function watched(page, milliseconds) {
  await page.$eval("#picture", (canvas) => {
    window.steps_shown = [];
    window.step_watch?.disconnect();
    window.step_watch = new MutationObserver(() => window.steps_shown.push([performance.now(), Number(canvas.dataset.step), canvas.dataset.quality]));
    window.step_watch.observe(canvas, { attributeFilter: ["data-frame"] });
  });
  await sleep(milliseconds);
  return page.evaluate(() => window.steps_shown);
}

// Pictures in motion per second.
function rate(shown) {
  const times = shown.filter(([, , quality]) => quality === "moving").map(([at]) => at);
  assert.ok(times.length > 2, `${times.length} pictures`);
  return (1000 * (times.length - 1)) / (times[times.length - 1] - times[0]);
}

export async function testRig({ open, options, folder, shots, passed }) {
  const server = await view(RIG, "--port=0", "--target=target", ...options);
  try {
    const page = await open(server.link);
    await atRest(page);
    const first = performance.now() - server.started;
    const begun = await pixels(page);
    assert.equal(await text(page, "step_number"), `1 / ${STEPS}`);

    await page.click("#play");
    await watched(page, 3000);
    // The governor finds its level, which takes some pictures, however long each takes.
    await until("it plays", async () => (await watched(page, 0), await sleep(1000), (await page.evaluate(() => window.steps_shown)).length > 1), 120_000);
    const playing = await watched(page, 5000);
    const steps = new Set(playing.map(([, step]) => step));
    assert.ok(steps.size > 2, `${steps.size} steps shown`);
    const dragged = await drag(page, 3000, "moving");
    assert.ok(dragged.shown > 0);
    passed(`a rig plays (${rate(playing).toFixed(1)} pictures a second), and goes on while it is dragged (${dragged.perSecond.toFixed(1)})`);

    await page.keyboard.press("Space");
    const paused = performance.now();
    const [last, rested] = [await page.$eval("#step", (slider) => Number(slider.value)), await atRest(page)];
    const toFullQuality = performance.now() - paused;
    assert.equal(Number(rested.step), last, "the newest wish is the one shown in the end");
    assert.deepEqual(await watched(page, 1000), [], "time stands still");
    passed("the space bar pauses it");

    // With a finger or a mouse the slider jumps; with keys it goes a step.
    const slider = await (await page.$("#step")).boundingBox();
    await page.mouse.click(slider.x + 0.8 * slider.width, slider.y + slider.height / 2);
    await until("another step at rest", async () => Number((await state(page)).step) !== last && (await state(page)).quality === "rest");
    const jumped = Number((await state(page)).step);
    await page.keyboard.press("ArrowRight");
    await until("the next step at rest", async () => Number((await state(page)).step) === jumped + 1 && (await state(page)).quality === "rest");
    assert.notEqual((await pixels(page)).hash, begun.hash);
    await sleep(300); // the plots follow the picture
    await page.screenshot({ path: join(shots, "rig.png") });
    passed(`scrubbing from step ${last} to ${jumped} and ${jumped + 1}`);

    await page.click("#record");
    const path = JSON.parse(await saved(page, "record", "path.json"));
    const png = await saved(page, "save", "picture.png");
    writeFileSync(join(folder, "rig.json"), JSON.stringify(path[path.length - 1]));
    const out = join(folder, "rig");
    mkdirSync(out);
    // All cameras but `target`, as the page had them.
    const rig = await rigWithout(folder, "target");
    liveview("video", rig, "--poses", join(folder, "rig.json"), `--frames=${jumped + 1}..${jumped + 2}`, "-o", out, ...options);
    const [name] = readdirSync(out);
    assert.ok(png.equals(readFileSync(join(out, name))), "other bytes than video's");
    passed("the saved PNG equals video's frame, byte for byte");

    await (await page.waitForSelector("#held_out button")).click();
    await until("a score", async () => (await text(page, "score")).includes("dB"));
    const scored = JSON.parse(liveview("video", RIG, "--camera=target", `--frames=${jumped + 1}..${jumped + 2}`, "--json", "-o", join(folder, "scored"), ...options));
    assert.equal(await text(page, "score"), `target: ${scored.mean.psnr.toFixed(2)} dB`);
    passed("a held-out camera's PSNR is video's");

    await atRest(page);
    await sleep(1000);
    const before = cpuSeconds(server.child.pid);
    await sleep(2000);
    const idle = (100 * (cpuSeconds(server.child.pid) - before)) / 2;
    assert.ok(idle < 1, `${idle} % CPU at rest`);
    await page.close();
    server.child.kill("SIGINT");
    assert.equal(await server.ended, 0);
    return { first, playing: rate(playing), dragging: dragged.perSecond, toFullQuality, idle };
  } finally {
    server.child.kill();
  }
}

// The rig without one of its cameras.
async function rigWithout(folder, camera) {
  const { cpSync } = await import("node:fs");
  const rig = join(folder, "without");
  cpSync(RIG, rig, { recursive: true });
  const file = join(rig, "transforms.json");
  const transforms = JSON.parse(readFileSync(file));
  transforms.frames = transforms.frames.filter((frame) => !frame.file_path.startsWith(camera));
  writeFileSync(file, JSON.stringify(transforms));
  return rig;
}
