// What a person does on the page, and what shows there.

import { existsSync, mkdtempSync, readFileSync, readdirSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

export const sleep = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));

export async function until(what, condition, limit = 30_000) {
  const end = performance.now() + limit;
  for (;;) {
    const value = await condition();
    if (value) return value;
    if (performance.now() > end) throw new Error(`${what}: not within ${limit / 1000} s`);
    await sleep(10);
  }
}

export const state = (page) => page.$eval("#picture", (canvas) => ({ ...canvas.dataset, status: document.getElementById("status").textContent }));
export const atRest = (page) => until("a picture at rest", async () => ((await state(page)).quality === "rest" ? state(page) : undefined));
export const text = (page, id) => page.$eval(`#${id}`, (found) => found.textContent);

// The canvas's pixels: a digest, and how much neighbours differ.
export function pixels(page) {
  return page.$eval("#picture", async (canvas) => {
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    let detail = 0;
    for (let i = 4; i < data.length; i += 4) detail += Math.abs(data[i + 1] - data[i - 3]);
    let hash = 2166136261;
    for (const value of data) hash = Math.imul(hash ^ value, 16777619) >>> 0;
    return { hash, detail: (4 * detail) / data.length };
  });
}

// Drags for so many milliseconds, or on a busy machine until a frame is shown, to and fro; frames shown meanwhile, and the time from the last
// movement to `end`, full quality unless something else moves.
export async function drag(page, milliseconds, end = "rest") {
  const box = await (await page.$("#picture")).boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await page.$eval("#picture", (canvas) => {
    window.frames_shown = [];
    window.last_move = 0;
    window.watching?.disconnect();
    window.watching = new MutationObserver(() => window.frames_shown.push([performance.now(), canvas.dataset.quality]));
    window.watching.observe(canvas, { attributeFilter: ["data-frame"] });
    canvas.addEventListener("pointermove", () => { window.last_move = performance.now(); });
  });
  await page.mouse.move(x, y);
  await page.mouse.down();
  const start = performance.now();
  let moving;
  while (performance.now() - start < milliseconds || (!moving && performance.now() - start < 30_000)) {
    const part = (performance.now() - start) / milliseconds;
    await page.mouse.move(x + 0.2 * box.width * Math.sin(7 * part), y + 0.1 * box.height * Math.sin(11 * part));
    await sleep(8);
    if (!moving && part > 0.8 && (await state(page)).quality === "moving") moving = { ...(await pixels(page)), ...(await state(page)) };
  }
  await page.mouse.up();
  const ended = (end) => window.frames_shown.some(([at, quality]) => at > window.last_move && quality === end);
  await until(`a picture after the drag (${end})`, () => page.evaluate(ended, end));
  const { frames, last } = await page.evaluate(() => ({ frames: window.frames_shown, last: window.last_move }));
  const shown = frames.filter(([, quality]) => quality === "moving").map(([at]) => at);
  const gaps = shown.slice(1).map((at, i) => at - shown[i]).sort((a, b) => a - b);
  return {
    moving,
    shown: shown.length,
    pictures: frames.length,
    perSecond: (1000 * (shown.length - 1)) / (shown[shown.length - 1] - shown[0]),
    medianGap: gaps[Math.floor(gaps.length / 2)],
    largestGap: gaps[gaps.length - 1],
    toFullQuality: frames.find(([at, quality]) => at > last && quality === end)[0] - last,
  };
}

// Clicks, and returns the file that this saves.
export async function saved(page, id, name) {
  const folder = mkdtempSync(join(tmpdir(), "liveview-browser-"));
  const session = await page.createCDPSession();
  await session.send("Browser.setDownloadBehavior", { behavior: "allow", downloadPath: folder });
  await page.$eval(`#${id}`, (button) => button.click());
  const file = join(folder, name);
  await until(`${name} is saved`, () => existsSync(file) && !readdirSync(folder).some((entry) => entry.endsWith(".crdownload")));
  return readFileSync(file);
}

// The close code and reason that a socket gets after sending this.
export function closing(page, link, message) {
  return page.evaluate((link, message) => new Promise((resolve) => {
    const socket = new WebSocket(`${link.replace(/^http/, "ws")}socket`);
    socket.onopen = () => (Array.isArray(message) ? message.forEach((one) => socket.send(one)) : socket.send(message));
    socket.onclose = ({ code, reason }) => resolve({ code, reason });
  }), link, message);
}
