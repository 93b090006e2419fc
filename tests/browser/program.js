// The program under test: `liveview view` on a free port, and other commands to compare with.

import { execFileSync, spawn } from "node:child_process";
import { readFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

export const ROOT = join(dirname(fileURLToPath(import.meta.url)), "../..");
export const SCENE = join(ROOT, "tests/scenes/workshop");
export const RIG = join(ROOT, "tests/scenes/rig");
const LIVEVIEW = join(ROOT, "target/release/liveview");

export function liveview(...args) {
  return execFileSync(LIVEVIEW, args, { encoding: "utf8", cwd: ROOT, stdio: ["ignore", "pipe", "pipe"] });
}

// Starts the viewer of a folder; `started` is when, `link` what it printed.
export async function view(folder, ...args) {
  const started = performance.now();
  const child = spawn(LIVEVIEW, ["view", folder, ...args], { cwd: ROOT, stdio: ["ignore", "pipe", "pipe"] });
  const ended = new Promise((resolve) => child.on("exit", (code) => resolve(code)));
  let said = "";
  const link = await new Promise((resolve, reject) => {
    child.stderr.on("data", (data) => {
      said += data;
      const found = said.match(/^open: (\S+)/m);
      if (found) resolve(found[1]);
    });
    ended.then((code) => reject(new Error(`exit code ${code}: ${said}`)));
  });
  return { child, ended, link, started };
}

// Seconds of processor time that a process has used so far, and its memory, MB.
export function used(pid) {
  const fields = readFileSync(`/proc/${pid}/stat`, "utf8").replace(/^.*\) /s, "").split(" ");
  const memory = readFileSync(`/proc/${pid}/status`, "utf8").match(/VmRSS:\s+(\d+)/);
  return { seconds: (Number(fields[11]) + Number(fields[12])) / 100, memory: Number(memory[1]) / 1024 };
}
