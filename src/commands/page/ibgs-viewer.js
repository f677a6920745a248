// <ibgs-viewer src="scene.ibgs" poster="poster.jpg" linked></ibgs-viewer> shows a bundle in the place and size of the element.
// Its attribute `state` is "loading", "base" once the base image shows while the rest still loads, then "ready" or "error",
// and it fires "ready", or "error" with a sentence in `detail`. With `linked` the page's address keeps camera and mode.

import init, { view } from "./pkg/ibgs_web.js";

const MEBIBYTE = 2 ** 20;
// Milliseconds between two looks at the viewer's camera and device.
const PULSE = 500;
// Starts after a lost device, until a reload.
const MOST_RESTARTS = 3;
const STYLE = `
  ibgs-viewer { display: block; position: relative; overflow: hidden; background: #1b1b1b; color: #ddd;
                font: 15px/1.4 system-ui, sans-serif; }
  ibgs-viewer canvas { display: block; width: 100%; height: 100%; touch-action: none; outline: none; }
  ibgs-viewer img { position: absolute; inset: 0; width: 100%; height: 100%; object-fit: cover; }
  ibgs-viewer p { position: absolute; left: 0; right: 0; bottom: 0; margin: 0; padding: 1em; text-align: center;
                  background: #1b1b1bd0; }
  ibgs-viewer progress { width: min(20em, 80%); }`;

/** How many bytes of a bundle, of which `done` are there, give the base image: its Gaussians, in a SOG file up to the spherical
    harmonics, and the next header of the ZIP archive; 0: not there yet. */
function startLength(bytes, done) {
  const view = new DataView(bytes.buffer);
  // Where the SOG file ends that is being walked; whether the Gaussians lie behind.
  let [sogEnd, isPast] = [0, false];
  for (let at = 0; at + 30 <= done; ) {
    if (view.getUint32(at, true) !== 0x04034b50) {
      // Its list of parts.
      if (!sogEnd) return 0;
      [at, sogEnd, isPast] = [sogEnd, 0, true];
      continue;
    }
    const [name, extra] = [view.getUint16(at + 26, true), view.getUint16(at + 28, true)];
    const end = at + 30 + name + extra;
    if (end > done) return 0;
    const text = new TextDecoder().decode(bytes.subarray(at + 30, at + 30 + name));
    if (isPast || (sogEnd && text.startsWith("shN_"))) return end;
    const next = end + view.getUint32(at + 18, true);
    isPast = text === "point_cloud.ply";
    if (text === "gaussians.sog") [at, sogEnd] = [end, next];
    else at = next;
  }
  return 0;
}

/** The bytes of a file; `report` is called with those that have come, how many they are, and of how many where that is known. */
async function download(url, report) {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`${url} cannot be loaded: ${answer.status} ${answer.statusText}`);
  const total = Number(answer.headers.get("Content-Length"));
  let bytes = new Uint8Array(Math.max(total, MEBIBYTE));
  let done = 0;
  for (const reader = answer.body.getReader(); ;) {
    const { value, done: ended } = await reader.read();
    if (ended) break;
    if (done + value.length > bytes.length) {
      // A compressed answer is longer than its header says.
      const more = new Uint8Array(2 * (done + value.length));
      more.set(bytes.subarray(0, done));
      bytes = more;
    }
    bytes.set(value, done);
    report(bytes, (done += value.length), total);
  }
  return bytes.subarray(0, done);
}

class IbgsViewer extends HTMLElement {
  connectedCallback() {
    // Moved within its page it runs on.
    if (this.canvas) return;
    if (!document.getElementById("ibgs-viewer-style")) {
      document.head.append(Object.assign(document.createElement("style"), { id: "ibgs-viewer-style", textContent: STYLE }));
    }
    this.restarts = 0;
    this.place = this.hasAttribute("linked") ? location.hash.slice(1) : "";
    if (this.hasAttribute("linked")) {
      addEventListener("hashchange", () => this.viewer?.followLink(location.hash.slice(1)));
    }
    this.run();
  }

  /** Loads and shows the bundle, and says what went wrong. */
  async run() {
    this.canvas = document.createElement("canvas");
    this.line = document.createElement("p");
    this.poster = this.hasAttribute("poster") ? Object.assign(new Image(), { src: this.getAttribute("poster"), alt: "" }) : "";
    this.replaceChildren(this.canvas, this.poster, this.line);
    this.setAttribute("state", "loading");
    try {
      await this.start();
      this.setAttribute("state", "ready");
      this.dispatchEvent(new CustomEvent("ready"));
    } catch (error) {
      const sentence = error?.message ?? String(error);
      this.line.hidden = false;
      this.line.textContent = sentence;
      this.setAttribute("state", "error");
      this.dispatchEvent(new CustomEvent("error", { detail: sentence }));
    }
  }

  async start() {
    if (!navigator.gpu) {
      throw new Error("This browser has no WebGPU, which shows the scene; try a current Chrome, Edge or Safari.");
    }
    const bar = document.createElement("progress");
    const text = document.createElement("span");
    this.line.replaceChildren(bar, document.createElement("br"), text);
    let base = null;
    let initialised = false;
    const report = (bytes, done, total) => {
      if (total >= done) [bar.max, bar.value] = [total, done];
      text.textContent = `${(done / MEBIBYTE).toFixed(1)} MiB` + (total >= done ? ` of ${(total / MEBIBYTE).toFixed(1)}` : "");
      // What comes first gives the base image, while the rest still loads.
      const length = base || !initialised || done === total ? 0 : startLength(bytes, done);
      if (length) base = this.show(bytes.slice(0, length), true);
    };
    const bundle = download(this.getAttribute("src"), report);
    // Its failure is reported below, also where the module fails first.
    bundle.catch(() => {});
    await init();
    initialised = true;
    const bytes = await bundle;
    const showsBase = await base;
    bar.removeAttribute("value");
    text.textContent = "opening";
    // The line is painted before the work begins.
    await new Promise(resolve => setTimeout(resolve, 50));
    if (showsBase) this.viewer.complete(bytes);
    else await this.show(bytes, false);
    text.textContent = "compiling for this GPU";
    await this.picture();
    this.line.hidden = true;
  }

  /** Shows a bundle, or its beginning; whether that was long enough. */
  async show(bytes, isStart) {
    const viewer = await view(this.canvas, bytes, isStart);
    if (!viewer) return false;
    this.viewer = viewer;
    if (this.place) this.viewer.followLink(this.place);
    this.pulse ??= setInterval(() => this.look(), PULSE);
    if (isStart) {
      const begun = () => this.getAttribute("state") === "loading" && this.setAttribute("state", "base");
      // What fails is reported once all is there.
      this.picture().then(begun, () => {});
    }
    return true;
  }

  /** Waits for the first picture, up to which the poster stays. */
  async picture() {
    while (!this.viewer.hasPicture()) {
      const error = this.viewer.isLost() ? "The browser has taken the GPU away." : this.viewer.error();
      if (error) {
        if (this.poster) this.poster.remove();
        throw new Error(error);
      }
      await new Promise(resolve => setTimeout(resolve, 50));
    }
    if (this.poster) this.poster.remove();
  }

  /** Keeps the page's address, and starts again after the device was lost. */
  look() {
    if (!this.viewer) return;
    // While it loads, the loss ends the loading with an error.
    if (this.viewer.isLost() && ["ready", "error"].includes(this.getAttribute("state"))) {
      this.viewer.end();
      this.viewer = null;
      if (this.restarts++ < MOST_RESTARTS) {
        this.run();
      } else {
        clearInterval(this.pulse);
        this.line.hidden = false;
        this.line.textContent = "The browser has taken the GPU away; reload the page.";
        this.setAttribute("state", "error");
      }
      return;
    }
    const place = this.viewer.link();
    if (!place || place === this.place) return;
    const isFirst = !this.place;
    this.place = place;
    if (this.hasAttribute("linked") && !isFirst) history.replaceState(null, "", `#${place}`);
  }
}

customElements.define("ibgs-viewer", IbgsViewer);
