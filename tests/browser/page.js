// What a person does on the page, and what shows there.

import { readFileSync } from "node:fs";

export const sleep = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));

export async function until(what, condition, limit = 120_000) {
  const end = performance.now() + limit;
  for (;;) {
    const value = await condition();
    if (value) return value;
    if (performance.now() > end) throw new Error(`${what}: not within ${limit / 1000} s`);
    await sleep(20);
  }
}

export const text = (page, id) => page.$eval(`#${id}`, (found) => found.textContent);
export const state = (page) => page.evaluate(() => ({ ...window.liveview.state, ...document.getElementById("picture").dataset, status: document.getElementById("status").textContent }));

// Until all depth is there, and all is drawn at rest.
export async function atRest(page) {
  let now;
  const rests = async () => {
    now = await state(page);
    return now.quality === "rest" && now.resting && !now.status.startsWith("depth of") && now;
  };
  return until("a picture at rest", rests).catch((error) => { throw new Error(`${error.message}: ${JSON.stringify({ ...now, frames: now.frames.slice(-3) })}`); });
}

// The canvas's pixels, rows from the top: a digest, and the PSNR against a picture of the same size.
export function pixels(page, truth) {
  const base64 = truth && readFileSync(truth).toString("base64");
  return page.evaluate(async (base64) => {
    const shown = window.liveview.pixels();
    let hash = 2166136261;
    for (const value of shown) hash = Math.imul(hash ^ value, 16777619) >>> 0;
    if (!base64) return { hash };
    const bitmap = await createImageBitmap(new Blob([Uint8Array.from(atob(base64), (c) => c.charCodeAt(0))]), { colorSpaceConversion: "none" });
    const { width, height } = document.getElementById("picture");
    const context = new OffscreenCanvas(width, height).getContext("2d");
    // Of a comparison the truth is at the left.
    context.drawImage(bitmap, 0, 0);
    const { data } = context.getImageData(0, 0, width, height);
    let sum = 0;
    for (let i = 0; i < data.length; i += 1) if (i % 4 < 3) sum += (data[i] - shown[i]) ** 2;
    return { hash, psnr: 10 * Math.log10((255 * 255 * 3 * width * height) / sum) };
  }, base64);
}

// Drags to and fro for so many milliseconds; gaps between finished frames meanwhile.
export async function drag(page, milliseconds, options = {}) {
  const box = await (await page.$("#picture")).boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(x, y);
  if (options.shift) await page.keyboard.down("Shift");
  await page.mouse.down();
  const begun = await page.evaluate(() => performance.now());
  const start = performance.now();
  while (performance.now() - start < milliseconds) {
    const part = (performance.now() - start) / milliseconds;
    await page.mouse.move(x + 0.12 * box.width * Math.sin(7 * part), y + 0.06 * box.height * Math.sin(11 * part));
    await sleep(8);
  }
  const frames = await page.evaluate((begun) => window.liveview.state.frames.filter(({ now }) => now > begun), begun);
  await page.mouse.up();
  if (options.shift) await page.keyboard.up("Shift");
  const gaps = frames.slice(1).map(({ now }, i) => now - frames[i].now).sort((a, b) => a - b);
  return { frames: frames.length, median: gaps[gaps.length >> 1], longest: gaps[gaps.length - 1] };
}

// Clicks, and returns the file that this saves.
export async function saved(page, id) {
  const [download] = await Promise.all([page.waitForEvent("download", { timeout: 120_000 }), page.click(`#${id}`)]);
  return { name: download.suggestedFilename(), bytes: readFileSync(await download.path()) };
}
