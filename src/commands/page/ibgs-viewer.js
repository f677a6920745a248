// <ibgs-viewer src="scene.ibgs" poster="poster.jpg"></ibgs-viewer> shows a bundle in the place and size of the element.
// Its attribute `state` is "loading", then "ready" or "error", and it fires "ready", or "error" with a sentence in `detail`.

import init, { view } from "./pkg/ibgs_web.js";

const MEBIBYTE = 2 ** 20;
const STYLE = `
  ibgs-viewer { display: block; position: relative; overflow: hidden; background: #1b1b1b; color: #ddd;
                font: 15px/1.4 system-ui, sans-serif; }
  ibgs-viewer canvas { display: block; width: 100%; height: 100%; touch-action: none; outline: none; }
  ibgs-viewer img { position: absolute; inset: 0; width: 100%; height: 100%; object-fit: cover; }
  ibgs-viewer p { position: absolute; left: 0; right: 0; bottom: 0; margin: 0; padding: 1em; text-align: center;
                  background: #1b1b1bd0; }
  ibgs-viewer progress { width: min(20em, 80%); }`;

/** The bytes of a file; `report` is called with how many have come, and of how many where the server says so. */
async function download(url, report) {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`${url} cannot be loaded: ${answer.status} ${answer.statusText}`);
  const total = Number(answer.headers.get("Content-Length"));
  const chunks = [];
  let done = 0;
  for (const reader = answer.body.getReader(); ;) {
    const { value, done: ended } = await reader.read();
    if (ended) break;
    chunks.push(value);
    report((done += value.length), total);
  }
  const bytes = new Uint8Array(done);
  let at = 0;
  for (const chunk of chunks) {
    bytes.set(chunk, at);
    at += chunk.length;
  }
  return bytes;
}

class IbgsViewer extends HTMLElement {
  async connectedCallback() {
    // Moved within its page it runs on.
    if (this.canvas) return;
    if (!document.getElementById("ibgs-viewer-style")) {
      document.head.append(Object.assign(document.createElement("style"), { id: "ibgs-viewer-style", textContent: STYLE }));
    }
    this.canvas = document.createElement("canvas");
    this.line = document.createElement("p");
    this.poster = this.hasAttribute("poster") ? Object.assign(new Image(), { src: this.getAttribute("poster"), alt: "" }) : "";
    this.replaceChildren(this.canvas, this.poster, this.line);
    this.setAttribute("state", "loading");
    try {
      await this.start();
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
    const report = (done, total) => {
      if (total >= done) [bar.max, bar.value] = [total, done];
      text.textContent = `${(done / MEBIBYTE).toFixed(1)} MiB` + (total >= done ? ` of ${(total / MEBIBYTE).toFixed(1)}` : "");
    };
    const [bundle] = await Promise.all([download(this.getAttribute("src"), report), init()]);
    bar.removeAttribute("value");
    text.textContent = "opening";
    // The line is painted before the work begins.
    await new Promise(resolve => setTimeout(resolve, 50));
    await view(this.canvas, bundle);
    this.line.hidden = true;
    if (this.poster) this.poster.remove();
    this.setAttribute("state", "ready");
    this.dispatchEvent(new CustomEvent("ready"));
  }
}

customElements.define("ibgs-viewer", IbgsViewer);
