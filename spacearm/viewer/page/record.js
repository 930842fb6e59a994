/* The drawing as a picture, and a motion as a video or picture by picture, made in this browser. */

import { zipped } from "./archive.js";
import { byId } from "./format.js";

const FRAMES_PER_SECOND = 30;
const MOST_FRAMES = 3000;

function keep(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

export function createRecorder(viewer, name) {
  const file = name.replace(/[^\p{L}\p{N}_.-]+/gu, "_") || "spacearm";
  byId("shot").hidden = !viewer;
  byId("shot").addEventListener("click", () => {
    viewer.render();
    viewer.renderer.domElement.toBlob((blob) => keep(blob, `${file}.png`));
  });

  /* Draws every frame in turn, however long that takes; a second click stops it. */
  function takeFrames(times, go) {
    const button = byId("frames");
    let running = false;
    button.hidden = !viewer;
    button.addEventListener("click", async () => {
      if (running) {
        running = false;
        return;
      }
      running = true;
      const all = times(FRAMES_PER_SECOND, MOST_FRAMES);
      const files = [];
      for (const [i, t] of all.entries()) {
        button.textContent = `Stop: ${i + 1} of ${all.length}`;
        await go(t);
        viewer.render();
        const blob = await new Promise((done) => viewer.renderer.domElement.toBlob(done));
        files.push([`${file}_${String(i + 1).padStart(4, "0")}.png`,
          new Uint8Array(await blob.arrayBuffer())]);
        if (!running) break;
      }
      if (running) keep(zipped(files), `${file}.zip`);
      running = false;
      button.textContent = "Frames";
    });
  }

  /* `playOnce(done)` plays the motion from its start and calls done() at its end; `times` says when
     the frames are; `go(t)` promises the drawing at a time. */
  return ({ playOnce: play, times }, go) => {
    takeFrames(times, go);
    const button = byId("film");
    button.hidden = !viewer || typeof MediaRecorder === "undefined";
    button.addEventListener("click", () => {
      const stream = viewer.renderer.domElement.captureStream(FRAMES_PER_SECOND);
      const recorder = new MediaRecorder(stream, { mimeType: "video/webm" });
      const parts = [];
      recorder.addEventListener("dataavailable", ({ data }) => parts.push(data));
      recorder.addEventListener("stop", () => {
        button.removeAttribute("aria-busy");
        button.disabled = false;
        keep(new Blob(parts, { type: "video/webm" }), `${file}.webm`);
      });
      button.setAttribute("aria-busy", "true");
      button.disabled = true;
      recorder.start();
      play(() => setTimeout(() => recorder.stop(), 300)); // the last frame is drawn by then
    });
  };
}
