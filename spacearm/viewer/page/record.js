/* The drawing as a picture, and a motion played once as a video, made in this browser. */

import { byId } from "./format.js";

const FRAMES_PER_SECOND = 30;

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

  /* `play(done)` plays the motion from its start and calls done() at its end. */
  return (play) => {
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
