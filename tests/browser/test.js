// The page in a headless Chromium with software WebGL: node test.js [scene …]; prints what it measured. CHROMIUM names another browser.

import assert from "node:assert/strict";
import { cpSync, existsSync, mkdirSync, mkdtempSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

import chromium from "@sparticuz/chromium";
import { chromium as playwright } from "playwright-core";

import { testControls, testSizes } from "./controls.js";
import { atRest, drag, pixels, sleep, state, text, until } from "./page.js";
import { RIG, ROOT, SCENE, liveview, used, view } from "./program.js";

const DATA = process.env.LIVEVIEW_DATA ?? join(ROOT, "../shared/data");
const SCENES = [
  ["workshop", SCENE, "target_0"], ["flower", join(DATA, "dev/llff_flower"), "images_8"], ["grid3x3", join(DATA, "dev/grid3x3"), "9.png"],
  ["beer", join(DATA, "dev/ordinary/beer"), "0012.jpg"], ["considering_bear", join(DATA, "dev/ordinary/considering_bear"), "0010.jpg"],
  ["pradyum_desk", join(DATA, "dev/ordinary/pradyum_desk"), "0010.jpg"], ["rgga_table2", join(DATA, "dev/ordinary/rgga_table2"), "0010.jpg"],
  ["fox", join(DATA, "train/fox"), "images"],
];
const folder = mkdtempSync(join(tmpdir(), "liveview-browser-"));
const shots = join(ROOT, "out/browser");
mkdirSync(shots, { recursive: true });
const passed = (what) => console.log(`ok  ${what}`);
const only = process.argv.slice(2);
const figures = [];
// What fails at the end, after all else was tested.
const missed = [];

const browser = await playwright.launch({
  executablePath: process.env.CHROMIUM ?? (await chromium.executablePath()),
  args: ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--font-render-hinting=none"],
});
const errors = [];
const requests = [];
// Opens a page; its errors, and all that it asks for, are kept.
async function open(link, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1200, height: 720 }, acceptDownloads: true, ...options });
  const page = await context.newPage();
  page.on("pageerror", (error) => errors.push(String(error)));
  page.on("console", (message) => message.type() === "error" && errors.push(message.text()));
  page.on("request", (request) => requests.push(request.url()));
  page.opened = performance.now();
  await page.goto(link);
  return page;
}
const sinceOpened = (page) => ((performance.now() - page.opened) / 1000).toFixed(2);
// Seconds from opening until something is drawn.
async function drawn(page) {
  await until("something to see", async () => (await state(page)).frame);
  return sinceOpened(page);
}
const close = (page) => page.context().close();
const file = (name) => `file://${join(folder, name)}`;
const servers = [];
const serve = async (...args) => {
  servers.push(await view(...args));
  return servers[servers.length - 1];
};

// Stands at the held-out photo, in its own pixels.
async function standAt(page, name) {
  await page.check("#exact");
  const index = await page.$$eval("#photo_list option", (options, name) => options.findIndex((option) => option.textContent.startsWith(name)), name);
  await page.selectOption("#photo_list", String(index));
  await until("the photo", async () => (await state(page)).at === index);
  return atRest(page);
}

async function pictures() {
  const rows = [];
  for (const [name, path, given] of SCENES.filter(([name, path]) => existsSync(path) && (only.length === 0 || only.includes(name)))) {
    // A photo, or the folder whose ninth it is.
    const target = given.startsWith("images") ? readdirSync(join(path, given)).sort()[8] : given;
    const common = ["--target", target, "--cache", join(folder, `cache_${name}`)];
    const baked = JSON.parse(liveview("bake", path, ...common, "--max-mb", "80", "-o", join(folder, `${name}.html`), "--json"));
    liveview("render", path, ...common, "--width", "640", "-o", join(folder, `${name}.png`), "--compare", join(folder, `${name}_compare.png`));
    const truth = join(folder, `${name}_compare.png`);
    const page = await open(file(`${name}.html`));
    await atRest(page);
    await standAt(page, target);
    const shown = await pixels(page, truth);
    const { vertices } = await state(page);
    await page.screenshot({ path: join(shots, `${name}.png`) });
    const library = await page.evaluate(psnr, [join(folder, `${name}.png`), truth].map((path) => readFileSync(path).toString("base64")));
    rows.push({ name, canvas: shown.psnr, library, vertices, megabytes: baked.bytes / 1e6, hash: shown.hash, target });
    console.log(`    ${name.padEnd(17)} canvas ${shown.psnr.toFixed(2)} dB, surface:3 ${library.toFixed(2)} dB, ${(shown.psnr - library).toFixed(2)}; ${vertices} vertices a frame; ${(baked.bytes / 1e6).toFixed(1)} MB`);
    await close(page);
  }
  const gaps = rows.map(({ canvas, library }) => canvas - library);
  const mean = gaps.reduce((sum, gap) => sum + gap, 0) / gaps.length;
  figures.push(`pictures: canvas less surface:3 ${mean.toFixed(2)} dB in the mean of ${rows.length} scenes, ${Math.min(...gaps).toFixed(2)} at worst`);
  // The mean is that of all eight scenes.
  if ((rows.length < SCENES.length || mean > -0.7) && Math.min(...gaps) > -1.5) passed("pictures are near the library's");
  else missed.push(figures[figures.length - 1]);
  return rows[0];
}

// In the page: the PSNR of a picture against the left of another.
async function psnr([picture, truth]) {
  const decoded = async (base64) => createImageBitmap(new Blob([Uint8Array.from(atob(base64), (c) => c.charCodeAt(0))]), { colorSpaceConversion: "none" });
  const [a, b] = [await decoded(picture), await decoded(truth)];
  const data = (bitmap) => {
    const context = new OffscreenCanvas(a.width, a.height).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    return context.getImageData(0, 0, a.width, a.height).data;
  };
  const [x, y] = [data(a), data(b)];
  let sum = 0;
  for (let i = 0; i < x.length; i += 1) sum += (x[i] - y[i]) ** 2;
  return 10 * Math.log10((255 * 255 * 3 * a.width * a.height) / sum);
}

async function served(first) {
  const server = await serve(SCENE, "--port=0", "--target", "target_0");
  const page = await open(server.link);
  const seen = await drawn(page);
  await atRest(page);
  const all = performance.now() - server.started;
  figures.push(`served: something drawn ${seen} s after the page opens (expected: 1.0 s at most), all depth of 8 photos ${(all / 1000).toFixed(2)} s after the command`);
  await standAt(page, "target_0");
  assert.equal((await pixels(page)).hash, first.hash, "the same canvas as the baked page's");
  passed("the served page and the baked one give the same canvas");
  await testControls({ page, server, folder, shots, passed });
  const before = used(server.child.pid);
  const others = [];
  for (let i = 0; i < 10; i += 1) others.push(await open(server.link, { viewport: { width: 320, height: 300 } }));
  await Promise.all(others.map((other) => until("all depth", async () => Number((await state(other)).found) === 8)));
  const after = used(server.child.pid);
  await sleep(1000);
  const idle = used(server.child.pid).seconds - after.seconds;
  figures.push(`ten clients: ${(1000 * (after.seconds - before.seconds) / 10).toFixed(0)} ms of the server's processor time each, memory ${before.memory.toFixed(0)} to ${after.memory.toFixed(0)} MB; ${(100 * idle).toFixed(0)} % at rest`);
  assert.ok(after.seconds - before.seconds < 2 && after.memory - before.memory < 40, figures[figures.length - 1]);
  await Promise.all(others.map(close));
  passed("ten clients on one server");
  server.child.kill("SIGINT");
  assert.equal(await server.ended, 0);
  await close(page);
  passed("Ctrl-C ends it");
}

async function dragging() {
  const page = await open(file("workshop.html"), { viewport: { width: 640 + 320 + 24, height: 460 } });
  const seen = await drawn(page);
  await atRest(page);
  figures.push(`baked: something drawn ${seen} s after the page opens (expected on an idle machine: 1.0 s at most), all at rest after ${sinceOpened(page)} s`);
  await page.evaluate(() => document.getElementById("frame").setAttribute("class", ""));
  const before = await pixels(page);
  await drag(page, 2500);
  const found = await drag(page, 4000);
  const { level, vertices } = await state(page);
  figures.push(`a drag at 640 pixels: ${found.frames} frames in 4 s, ${found.median.toFixed(0)} ms apart (median), at most ${found.longest.toFixed(0)} ms (expected on an idle machine: 100 ms at most); level ${level}, ${vertices} vertices a frame`);
  await atRest(page);
  assert.notEqual((await pixels(page)).hash, before.hash);
  await close(page);
  passed("a drag");
}

async function hostile() {
  // The first time step of the example rig, under names that would be elements and handlers.
  const scene = join(folder, "'\"><svg onload=window.hacked=2>");
  mkdirSync(scene);
  const described = JSON.parse(readFileSync(join(RIG, "transforms.json"), "utf8"));
  described.frames.forEach((frame, i) => {
    const name = `${i}<!--<script><img src=x onerror='window.hacked=1'>".jpg`;
    cpSync(join(RIG, frame.file_path), join(scene, name));
    frame.file_path = name;
  });
  writeFileSync(join(scene, "transforms.json"), JSON.stringify(described));
  liveview("bake", scene, "--width", "160", "-o", join(folder, "hostile.html"));
  const page = await open(file("hostile.html"));
  await atRest(page);
  assert.equal(await page.evaluate(() => window.hacked), undefined);
  assert.ok((await page.$$eval("#photo_list option", (all) => all.map((one) => one.textContent))).some((one) => one.includes("onerror")));
  await page.evaluate(() => {
    const script = document.createElement("script");
    script.textContent = "window.hacked = 3";
    document.body.append(script);
    document.body.insertAdjacentHTML("beforeend", "<img src=x onerror='window.hacked = 4'>");
  });
  await sleep(200);
  assert.equal(await page.evaluate(() => window.hacked), undefined, "scripts of others do not run");
  errors.length = 0; // the policy's own reports
  await close(page);
  // Damaged photos and depths are left out, and said.
  const html = readFileSync(join(folder, "hostile.html"), "utf8");
  let count = 0;
  const damaged = html.replace(/"(depth|photo)":"([A-Za-z0-9+/=]{40})/g, (all, kind, start) => {
    count += 1;
    return count === 3 || count === 6 ? `"${kind}":"AAAA${start.slice(4)}` : all;
  });
  writeFileSync(join(folder, "damaged.html"), damaged);
  const other = await open(file("damaged.html"));
  await until("a picture", async () => (await state(other)).frame);
  await until("what was left out", async () => (await text(other, "message")).includes("Left out"));
  await close(other);
  passed("hostile names, photos and depths");
}

async function withoutWebGl() {
  const context = await browser.newContext({ viewport: { width: 800, height: 600 } });
  const page = await context.newPage();
  await page.addInitScript(() => {
    const real = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function get(kind, ...rest) { return kind === "webgl2" ? null : real.call(this, kind, ...rest); };
  });
  await page.goto(file("workshop.html"));
  await until("the photos", async () => (await page.$$("#photos canvas")).length >= 8);
  assert.match(await text(page, "message"), /WebGL 2 is missing.*photos/);
  await page.screenshot({ path: join(shots, "without_webgl.png") });
  await context.close();
  passed("without WebGL 2 the photos are shown");
}

async function rig() {
  const server = await serve(RIG, "--port=0");
  const page = await open(server.link);
  await until("a picture", async () => (await state(page)).frame);
  await page.click("#play");
  const begun = performance.now();
  await until("time steps", async () => (await state(page)).step >= 3);
  figures.push(`a rig: the fourth time step ${((performance.now() - begun) / 1000).toFixed(1)} s after play`);
  await page.click("#play");
  await page.$eval("#step", (slider) => { slider.value = 1; slider.dispatchEvent(new Event("input")); });
  await until("the second time step", async () => (await state(page)).step === "1");
  await page.screenshot({ path: join(shots, "rig.png") });
  await close(page);
  server.child.kill();
  passed("the time steps of a rig");
}

try {
  const first = await pictures();
  requests.length = 0;
  await dragging();
  await testSizes({ open, close, file, shots, passed });
  await hostile();
  await withoutWebGl();
  assert.deepEqual(requests.filter((url) => !url.startsWith("file://") && !url.startsWith("blob:") && !url.startsWith("data:")), [], "a baked page loads nothing");
  passed("a baked page loads nothing from anywhere");
  if (first.name === "workshop") await served(first);
  await rig();
  assert.deepEqual(errors, []);
  console.log(`\n${figures.join("\n")}\nTexture reads a pixel: at most 45 (computed from the shaders); on a graphics processor this is far above 60 frames a second (computed, not measured).`);
  assert.deepEqual(missed, [], "expected at most 0.7 dB in the mean of the eight scenes, at most 1.5 dB on each");
} finally {
  await browser.close();
  servers.forEach(({ child }) => child.kill());
}
