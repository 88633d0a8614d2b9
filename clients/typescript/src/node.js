/** Where the service is, for programs of this user under Node: what `service.json` says. */

import { readFile } from "node:fs/promises";
import { homedir, platform } from "node:os";
import { join } from "node:path";

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
 * Return address and token of the service; for `connect({find})`.
 * @returns {Promise<{url: string, token: string}>}
 */
export async function find() {
  const path = join(folder(), "service.json");
  let text;
  try {
    text = await readFile(path, "utf8");
  } catch (error) {
    throw new Error(`${path} cannot be read: start haptix serve`, { cause: error });
  }
  const { port, token } = JSON.parse(text);
  return { url: `ws://127.0.0.1:${port}/v1/session`, token };
}
