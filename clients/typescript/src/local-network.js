/** Whether a browser lets a page of another machine reach the service of this one. */

const LOCAL = /^(localhost|127\.[\d.]+|\[::1\])$/;
// Chrome 142 to 144 had one permission, later versions have two; other browsers have none.
const NAMES = ["loopback-network", "local-network-access"];

/** Return the state of the permission; "" where the browser, or this page, needs none.
 * @returns {Promise<PermissionState | "">} */
async function permission() {
  if (!globalThis.navigator?.permissions || !globalThis.location || LOCAL.test(location.hostname)) return "";
  for (const name of NAMES) {
    try {
      return (await navigator.permissions.query({ name: /** @type {any} */ (name) })).state;
    } catch {
      // not of this browser
    }
  }
  return "";
}

/**
 * Let the browser ask the person for the permission, where it has one that was not asked for yet.
 * @param {string} url of the service
 */
export async function askPermission(url) {
  if ((await permission()) !== "prompt") return;
  const address = new URL("/", url.replace(/^ws/, "http"));
  await fetch(address, { mode: "no-cors", cache: "no-store" }).catch(() => {}); // a socket says nothing of it
}

/**
 * Return what is in the way of a service that does not answer, and what to do.
 * @param {string} url of the service
 * @returns {Promise<string>}
 */
export async function obstacle(url) {
  const state = await permission();
  const policy = /** @type {any} */ (globalThis.document)?.featurePolicy;
  if (globalThis.isSecureContext === false && !LOCAL.test(location.hostname)) {
    return `${url} cannot be reached from this page: browsers want https, or a page of 127.0.0.1`;
  }
  if (state !== "" && NAMES.every((name) => !policy?.allowsFeature(name))) {
    return `the browser keeps this iframe from ${url}: write <iframe allow="${NAMES.join("; ")}">`;
  }
  if (state === "denied") {
    return `the browser keeps this page from ${url}: allow it the local network in the site's settings, and reload`;
  }
  if (state === "prompt") {
    return `the browser keeps this page from ${url}: answer its question about the local network, and connect again`;
  }
  const page = globalThis.location ? ", or pair this page by the code that it shows" : "";
  return `no service answers at ${url}: start haptix serve${page}`;
}
