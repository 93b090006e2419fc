// The page's controls, and its shape on several screens.

import assert from "node:assert/strict";
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";

import { atRest, drag, pixels, saved, sleep, state, text, until } from "./page.js";
import { SCENE, liveview } from "./program.js";

// On a served page that stands at the held-out photo target_0.
export async function testControls({ page, folder, shots, passed }) {
  const score = Number((await text(page, "score")).match(/([\d.]+) dB against target_0/)[1]);
  assert.ok(score > 20 && score < 40, `${score}`);
  const picture = await pixels(page);
  await page.$eval("#wipe", (slider) => { slider.value = 1; slider.dispatchEvent(new Event("input")); });
  assert.notEqual((await pixels(page)).hash, picture.hash);
  await page.screenshot({ path: join(shots, "wipe.png") });
  passed("a wipe between photo and picture, and the score");

  await page.click("#quality");
  await until("full quality", () => page.$eval("#full", (image) => image.classList.contains("shown")));
  const png = await saved(page, "save");
  liveview("render", SCENE, "--target", "target_0", "-o", join(folder, "full.png"));
  assert.ok(png.bytes.equals(readFileSync(join(folder, "full.png"))), "other bytes than render's");
  passed("the picture at full quality is render's, byte for byte");

  const centre = async () => (await state(page)).camera.cam_from_world.flat().map((value) => value.toFixed(6)).join();
  const changes = async (what, action) => {
    const before = await centre();
    await action();
    await until(`${what} moves the viewpoint`, async () => (await centre()) !== before);
    await atRest(page);
  };
  await changes("orbit", () => drag(page, 400));
  assert.ok(await page.$eval("#full", (image) => image.hidden), "full quality goes when the viewpoint moves");
  await changes("pan", () => drag(page, 400, { shift: true }));
  await changes("wheel", () => page.mouse.wheel(0, -200));
  await page.focus("#picture");
  for (const key of ["ArrowLeft", "Shift+ArrowUp", "+"]) {
    await changes(key, async () => {
      const [shift, name] = key.startsWith("Shift+") ? [true, key.slice(6)] : [false, key];
      if (shift) await page.keyboard.down("Shift");
      await page.keyboard.down(name);
      await sleep(250);
      await page.keyboard.up(name);
      if (shift) await page.keyboard.up("Shift");
    });
  }
  await changes("the nearest photo", () => page.keyboard.press("h"));
  await until("the photo", async () => (await state(page)).at !== undefined);
  const box = await (await page.$("#map")).boundingBox();
  const { at } = await state(page);
  await until("another photo, clicked on the map", async () => {
    await page.mouse.click(box.x + box.width * (0.2 + 0.6 * Math.random()), box.y + box.height * (0.1 + 0.8 * Math.random()));
    await sleep(300);
    const now = await state(page);
    return now.at !== undefined && now.at !== at;
  });
  await atRest(page);
  passed("orbit, pan, wheel, keys, the nearest photo, the map of the rig");

  for (const id of ["depth", "guessed"]) {
    const before = await pixels(page);
    await page.check(`#${id}`);
    if (id === "depth") await until("depth in colour", async () => (await pixels(page)).hash !== before.hash, 30_000);
    await atRest(page);
    await page.screenshot({ path: join(shots, `${id}.png`) });
    await page.uncheck(`#${id}`);
    await atRest(page);
  }
  await page.$eval("#view", (slider) => { slider.value = 0.4; slider.dispatchEvent(new Event("input")); });
  await until("a wider field of view", async () => Number.parseFloat(await text(page, "degrees")) > 60);
  await atRest(page);
  passed("depth and guessed pixels, field of view");

  await page.click("#key");
  await drag(page, 300);
  await page.click("#key");
  assert.match(await text(page, "keys"), /2 keyframes, 2 s/);
  const path = await saved(page, "path");
  const cameras = JSON.parse(path.bytes);
  assert.equal(cameras.length, 61);
  writeFileSync(join(folder, "path.json"), JSON.stringify(cameras.slice(0, 3)));
  liveview("render", SCENE, "--path", join(folder, "path.json"), "--width", "160", "-o", join(folder, "path"));
  assert.equal(readdirSync(join(folder, "path")).filter((name) => name.endsWith(".png")).length, 3);
  await page.click("#run");
  await until("the end of the path", async () => (await text(page, "run")) === "Play");
  passed("keyframes, play, and path.json renders");
  const records = await page.evaluate(() => Boolean(globalThis.MediaRecorder) && ["video/webm;codecs=vp9", "video/webm", "video/mp4"].some((kind) => MediaRecorder.isTypeSupported(kind)));
  if (records) {
    const video = await saved(page, "video");
    assert.match(video.name, /^video\.(webm|mp4)$/);
    // A headless shell may hand no frames of a WebGL canvas to its recorder.
    if (video.bytes.length > 5000) passed(`a video of ${(video.bytes.length / 1e3).toFixed(0)} kB`);
    else console.log(`    the recorded video has ${video.bytes.length} bytes, no frames: not tested in this browser`);
  } else console.log("    this browser records no video: not tested");
}

// First screens, whole, in light and dark; controls by keyboard, with names and visible focus.
export async function testSizes({ open, close, file, shots, passed }) {
  for (const [width, height, colorScheme] of [[390, 844, "light"], [390, 844, "dark"], [844, 390, "light"], [1440, 900, "dark"], [1440, 900, "light"]]) {
    const page = await open(file("workshop.html"), { viewport: { width, height }, colorScheme, hasTouch: width < 1000 });
    await atRest(page);
    await sleep(300);
    const shot = join(shots, `${width}x${height}_${colorScheme}.png`);
    await page.screenshot({ path: shot });
    const { left, top, right, bottom } = await page.$eval("#picture", (canvas) => canvas.getBoundingClientRect().toJSON());
    assert.ok(left >= 0 && top >= 0 && right <= width && bottom <= height, `${shot}: the picture is cut off`);
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth && document.documentElement.scrollHeight <= innerHeight), `${shot}: beyond the screen`);
    if (colorScheme === "light") {
      const all = await page.$$eval("button, input, select, summary, canvas[tabindex]", (found) => found.filter((one) => one.checkVisibility() && !one.disabled).map((one) => one.id || one.tagName));
      const reached = new Set();
      for (let i = 0; i < 2 * all.length; i += 1) {
        await page.keyboard.press("Tab");
        const focused = await page.evaluate(() => {
          const one = document.activeElement;
          return { id: one.id || one.tagName, outline: getComputedStyle(one).outlineStyle !== "none", name: one.getAttribute("aria-label") || one.labels?.[0]?.textContent.trim() || one.textContent.trim() };
        });
        if (focused.id === "BODY") continue;
        assert.ok(focused.outline && focused.name, JSON.stringify(focused));
        reached.add(focused.id);
      }
      assert.deepEqual(all.filter((id) => !reached.has(id)), [], "not reached by keyboard");
    }
    if (width < 1000 && colorScheme === "light") {
      const before = await pixels(page);
      await touch(page);
      await atRest(page);
      assert.notEqual((await pixels(page)).hash, before.hash, "a touch moves the viewpoint");
    }
    await close(page);
  }
  passed("five first screens; controls by keyboard, with names; touch");
}

// One finger, then two that move apart.
async function touch(page) {
  const session = await page.context().newCDPSession(page);
  const box = await (await page.$("#picture")).boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  const send = (type, points) => session.send("Input.dispatchTouchEvent", { type, touchPoints: points.map(([dx, dy], id) => ({ x: x + dx, y: y + dy, id })) });
  await send("touchStart", [[0, 0]]);
  for (let i = 1; i < 6; i += 1) await send("touchMove", [[6 * i, 2 * i]]);
  await send("touchEnd", []);
  await send("touchStart", [[-20, 0], [20, 0]]);
  for (let i = 1; i < 6; i += 1) await send("touchMove", [[-20 - 4 * i, 0], [20 + 4 * i, 0]]);
  await send("touchEnd", []);
}
