/** Where the service is, for programs of this user under Node: what `service.json` says. */

import { createHash, randomBytes } from "node:crypto";
import { mkdir, readFile, rename, writeFile } from "node:fs/promises";
import { homedir, platform } from "node:os";
import { dirname, join } from "node:path";

function folder() {
  const { HAPTIX_SERVICE, LOCALAPPDATA, XDG_STATE_HOME } = process.env;
  if (HAPTIX_SERVICE) return HAPTIX_SERVICE;
  const parts = ["haptix", "service"];
  if (platform() === "darwin") {
    return join(homedir(), "Library", "Application Support", ...parts);
  }
  if (platform() === "win32") {
    return join(LOCALAPPDATA ?? join(homedir(), "AppData", "Local"), ...parts);
  }
  return join(XDG_STATE_HOME || join(homedir(), ".local", "state"), ...parts);
}

/**
 * Return address and token of the service, STOP's own address, and the word of an app; for
 * `connect({find})`.
 * @param {string} [name] of the app
 * @returns {Promise<{url: string, token: string, app: string, stop?: string}>}
 */
export async function find(name = "") {
  const path = join(folder(), "service.json");
  let text;
  try {
    text = await readFile(path, "utf8");
  } catch (error) {
    throw new Error(`${path} cannot be read: start haptix serve`, { cause: error });
  }
  const { url, token, stop_port } = JSON.parse(text);
  const stop = stop_port && `http://127.0.0.1:${stop_port}/stop`;
  return { url, token, stop, app: await wordOf(name) };
}

/** @param {string} name */
async function wordOf(name) {
  const path = join(folder(), "apps", createHash("sha256").update(name).digest("hex"));
  const known = await readFile(path, "utf8").catch(() => "");
  if (known) return known;
  const [word, whole] = [randomBytes(16).toString("hex"), `${path}.${process.pid}`];
  try {
    await mkdir(dirname(path), { recursive: true, mode: 0o700 });
    await writeFile(whole, word, { mode: 0o600 });
    await rename(whole, path);
  } catch (error) {
    console.warn(`after a crash the output is refused for 30 s: ${error}`);
  }
  return word;
}
