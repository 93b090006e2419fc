// `liveview view` in a real browser: node test.js [options of liveview view]; prints what it measured. CHROMIUM names another browser.

import assert from "node:assert/strict";
import { mkdirSync, mkdtempSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

import chromium from "@sparticuz/chromium";
import puppeteer from "puppeteer-core";

import { atRest, closing, drag, pixels, saved, sleep, state, text, until } from "./page.js";
import { ROOT, SCENE, cpuSeconds, liveview, view } from "./program.js";
import { testRig } from "./rig.js";
import { testTouch } from "./touch.js";

const options = process.argv.slice(2);
const folder = mkdtempSync(join(tmpdir(), "liveview-browser-"));
const shots = join(ROOT, "out/browser");
mkdirSync(shots, { recursive: true });
const seconds = (milliseconds) => `${(milliseconds / 1000).toFixed(2)} s`;
const passed = (what) => console.log(`ok  ${what}`);

const browser = await puppeteer.launch({
  executablePath: process.env.CHROMIUM ?? (await chromium.executablePath()),
  args: ["--no-sandbox", "--disable-gpu", "--font-render-hinting=none"],
  headless: "shell",
});
const server = await view(SCENE, "--port=0", ...options);
let other;
try {
  const errors = [];
  const open = async (link, viewport = { width: 1200, height: 720 }) => {
    const page = await browser.newPage();
    await page.setViewport(viewport);
    page.on("pageerror", (error) => errors.push(String(error)));
    page.on("console", (message) => message.type() === "error" && errors.push(message.text()));
    await page.goto(link);
    return page;
  };

  const opened = performance.now();
  const page = await open(server.link);
  await until("something to see", async () => (await state(page)).frame);
  const seen = performance.now() - opened;
  await atRest(page);
  const first = performance.now() - server.started;
  const begun = await pixels(page);
  assert.ok(begun.detail > 1, "a picture, not a plain colour");
  passed("the first picture appears");

  await drag(page, 1500); // photos' depth is found once
  const [busy, dragged] = [cpuSeconds(server.child.pid), await drag(page, 4000)];
  const each = (1000 * (cpuSeconds(server.child.pid) - busy)) / dragged.pictures;
  assert.ok(dragged.moving, "a picture while it moves");
  const rested = { ...(await pixels(page)), ...(await atRest(page)) };
  assert.notEqual(rested.hash, begun.hash);
  passed("a drag changes the picture");
  assert.match(rested.status, /full quality · 504 × 352/);
  assert.notEqual(rested.hash, dragged.moving.hash);
  if (!dragged.moving.status.includes("504 × 352")) assert.ok(rested.detail > dragged.moving.detail, "more detail at rest");
  passed(`resting sharpens it (${dragged.moving.status} before)`);

  await page.click("#record");
  await drag(page, 700);
  await atRest(page);
  const png = await saved(page, "save", "picture.png");
  const canvas = await pixels(page);
  const path = JSON.parse(await saved(page, "record", "path.json"));
  assert.ok(path.length > 15, `${path.length} cameras of a drag of 0.7 s`);
  writeFileSync(join(folder, "pose.json"), JSON.stringify(path[path.length - 1]));
  liveview("render", SCENE, "--pose", join(folder, "pose.json"), "-o", join(folder, "pose.png"), ...options);
  assert.ok(png.equals(readFileSync(join(folder, "pose.png"))), "other bytes than render's");
  passed("the saved PNG equals render's, byte for byte");
  const decoded = await page.evaluate(async (base64) => {
    const bytes = Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([bytes]));
    const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    const { data } = context.getImageData(0, 0, bitmap.width, bitmap.height);
    return data.reduce((hash, value) => Math.imul(hash ^ value, 16777619) >>> 0, 2166136261);
  }, png.toString("base64"));
  assert.equal(decoded, canvas.hash, "what is shown is what is saved");
  writeFileSync(join(folder, "path.json"), JSON.stringify(path.slice(0, 12)));
  liveview("render", SCENE, "--pose", join(folder, "path.json"), "-o", join(folder, "frames"), ...options);
  const frames = readdirSync(join(folder, "frames")).filter((name) => name.endsWith(".png"));
  assert.equal(frames.length, Math.min(12, path.length));
  passed(`the recorded path of ${path.length} cameras renders`);

  const second = await open(server.link);
  await atRest(second);
  const both = await Promise.all([drag(page, 2000), drag(second, 2000)]);
  assert.ok(both.every((one) => one.shown > 0));
  passed(`a second client (${both.map((one) => one.shown).join(" and ")} pictures in two seconds or more)`);
  await second.close();

  await page.reload();
  await atRest(page);
  assert.equal((await pixels(page)).hash, begun.hash, "it begins where it began");
  passed("a reload");

  await page.click("#depth");
  await until("depth in colour", async () => (await pixels(page)).hash !== begun.hash);
  await page.screenshot({ path: join(shots, "depth.png") });
  await page.click("#depth");
  await until("the picture again", async () => (await pixels(page)).hash === begun.hash);
  passed("depth as colours");

  for (const [message, code, word] of [
    ["{", 1008, "not JSON"],
    ['{"camera": {}, "id": 1, "moving": false, "depth": false}', 1008, "cam_from_world"],
    ["x".repeat(5000), 1009, "at most 4096"],
    [Array(500).fill('{"shown": 1}'), 1008, "too many messages"],
  ]) {
    const end = await closing(page, server.link, message);
    assert.equal(end.code, code, JSON.stringify(end));
    assert.ok(end.reason.includes(word), JSON.stringify(end));
  }
  await drag(page, 300);
  passed("hostile messages are answered with a reason, and others go on");
  assert.deepEqual(errors, []);

  const foreign = await browser.newPage();
  await foreign.goto("data:text/html,another page");
  assert.equal((await closing(foreign, server.link, "{")).code, 1006);
  await foreign.close();
  passed("another page is refused");

  await atRest(page);
  await sleep(5000); // the depth of the photos around is found meanwhile
  const before = cpuSeconds(server.child.pid);
  await sleep(3000);
  const idle = (100 * (cpuSeconds(server.child.pid) - before)) / 3;
  assert.ok(idle < 1, `${idle} % CPU at rest`);

  const { port } = new URL(server.link);
  server.child.kill("SIGINT");
  const stopped = performance.now();
  assert.equal(await server.ended, 0);
  passed(`Ctrl-C ends it (${seconds(performance.now() - stopped)})`);
  await until("the lost connection is reported", async () => (await text(page, "message")).includes("Trying again"));
  other = await view(SCENE, `--port=${port}`, "--target=target_0,target_1", ...options);
  await until("a picture after the loss", async () => (await state(page)).quality === "rest");
  passed("a dropped connection is taken up again");

  await page.reload();
  await atRest(page);
  const target = await page.waitForSelector("#held_out button");
  const name = await target.evaluate((button) => button.textContent);
  await target.click();
  await until("a score", async () => (await text(page, "score")).includes("dB"));
  const scored = JSON.parse(liveview("render", SCENE, "--target=target_0,target_1", "--json", "-o", join(folder, "targets"), ...options));
  const psnr = scored.targets.find((one) => one.name === name).psnr;
  assert.equal(await text(page, "score"), `${name}: ${psnr.toFixed(2)} dB`);
  passed("a held-out photo's PSNR is render's");

  await page.focus("#map");
  const stood = (await state(page)).frame;
  await page.keyboard.press("ArrowRight");
  await until("the next photo on the map", async () => (await state(page)).frame !== stood);
  passed("arrow keys on the map");

  await page.click("#side");
  await until("the nearest photo", () => page.$eval("#photo", (photo) => photo.complete && photo.naturalWidth === 504));
  await page.screenshot({ path: join(shots, "beside.png") });
  await page.click("#side");
  await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "dark" }]);
  await drag(page, 800);
  await page.screenshot({ path: join(shots, "dark.png") });
  const phone = await open(other.link, { width: 390, height: 844, deviceScaleFactor: 2, isMobile: true, hasTouch: true });
  await atRest(phone);
  await sleep(300); // the plots follow the picture
  await phone.screenshot({ path: join(shots, "phone.png"), fullPage: true });
  assert.ok(await phone.evaluate(() => document.documentElement.scrollWidth <= innerWidth), "nothing beyond a phone's screen");
  passed("dark, and on a phone's screen");
  await testTouch(phone, passed);
  await phone.close();
  const sideways = await open(other.link, { width: 844, height: 390, deviceScaleFactor: 2, isMobile: true, hasTouch: true });
  await atRest(sideways);
  await sleep(300);
  await sideways.screenshot({ path: join(shots, "sideways.png") });
  const { top, bottom, right } = await sideways.$eval("#picture", (canvas) => canvas.getBoundingClientRect().toJSON());
  assert.ok(top >= 0 && bottom <= 390 && right <= 844, `cut off: ${top} to ${bottom} of 390, ${right} of 844`);
  await sideways.close();
  passed("on a phone held sideways");
  await page.close();
  other.child.kill();
  errors.length = 0; // of the connection that was dropped
  const rig = await testRig({ open, options, folder, shots, passed });
  assert.deepEqual(errors, []);

  console.log(`\n${options.join(" ") || "no options"}: something to see ${seconds(seen)} after the page is opened, full quality ${seconds(first)} after the command; ${dragged.perSecond.toFixed(1)} frames a second while ` +
    `dragging (median ${dragged.medianGap.toFixed(0)} ms apart, at most ${dragged.largestGap.toFixed(0)} ms; ${dragged.moving.status}), ${each.toFixed(0)} ms of CPU each; full quality ${seconds(dragged.toFullQuality)} ` +
    `after the last movement; ${idle.toFixed(1)} % CPU at rest`);
  console.log(`a rig: first picture ${seconds(rig.first)} after the command; ${rig.playing.toFixed(1)} pictures a second while it plays, ` +
    `${rig.dragging.toFixed(1)} while it is dragged too; full quality ${seconds(rig.toFullQuality)} after the pause; ${rig.idle.toFixed(1)} % CPU at rest`);
} finally {
  await browser.close();
  server.child.kill();
  other?.child.kill();
}
