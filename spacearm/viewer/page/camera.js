/* The camera: frames the whole robot with its tip and ellipsoid, from a preset direction or from
   where it was turned to; a scale bar and the inertial axes go with it. */

import { byId, digits } from "./format.js";
import { createTicks } from "./ticks.js";

const FRAMED = ["bodies", "tip frame", "ellipsoid", "centre of mass", "virtual manipulator",
  "directions", "obstacles", "target", "trace", "goal", "comparison", "shells", "risk", "attitudes", "wheels",
  "wrenches"];
const MARGIN = 0.1; // of the half width and height that stays free
const FIELD = 45; // degrees, from the lower to the upper edge
const PRESETS = { front: [1, 0, 0], side: [0, -1, 0], top: [0, 0, 1] };

export function createCamera(viewer, { view, grid }) {
  if (!viewer) return { fit() {}, keep() {}, take() {} };
  const { Vector3 } = MeshCat.THREE;
  const inertial = (x, y, z) => new Vector3(x, z, -y); // three.js has y upwards, meshcat turns it
  let direction = inertial(...view).normalize();
  let whole = null; // what of a motion is to be seen, from its start to its end
  let moved = false; // by hand: then it stays where it is
  const { camera, controls } = viewer;
  camera.fov = FIELD;
  const drawTicks = createTicks(viewer, grid);
  controls.addEventListener("start", () => (moved = true));
  controls.addEventListener("change", drawRuler);

  function points() {
    const found = [];
    viewer.scene.updateMatrixWorld(true);
    for (const name of FRAMED) collect(viewer.scene_tree.find(["spacearm", name]).object, found);
    return found;
  }

  function collect(node, found) {
    if (!node.visible) return;
    if (node.geometry) {
      if (!node.geometry.boundingBox) node.geometry.computeBoundingBox();
      const { min, max } = node.geometry.boundingBox;
      const round = node.geometry.type === "SphereGeometry";
      const middle = min.clone().add(max).multiplyScalar(0.5);
      for (let i = 0; i < (round ? 6 : 8); i++) {
        const corner = round ? middle.clone() : new Vector3();
        if (round) corner.setComponent(i % 3, (i < 3 ? min : max).getComponent(i % 3));
        else corner.set((i & 1 ? max : min).x, (i & 2 ? max : min).y, (i & 4 ? max : min).z);
        corner.applyMatrix4(node.matrixWorld);
        if (Number.isFinite(corner.lengthSq())) found.push(corner);
      }
    }
    node.children.forEach((child) => collect(child, found));
  }

  /* How far up the drawing is free, from 0 in the middle to 1; the buttons stand above. */
  function belowButtons() {
    const bar = byId("view").getBoundingClientRect();
    const { top, height } = byId("scene").getBoundingClientRect();
    return bar.height > 0 && height > 0 ? Math.max(1 - (2 * (bar.bottom - top)) / height, 0.2) : 1;
  }

  function fit(all = whole ?? points()) {
    if (!all.length || !(camera.aspect > 0)) return;
    moved = false;
    const centre = all.reduce((sum, p) => sum.add(p), new Vector3()).multiplyScalar(1 / all.length);
    const up = inertial(...(Math.abs(direction.y) > 0.999 ? [0, 1, 0] : [0, 0, 1]));
    const right = up.clone().cross(direction).normalize();
    up.copy(direction).cross(right);
    const high = Math.tan((camera.fov * Math.PI) / 360);
    const [wide, free] = [high * camera.aspect * (1 - MARGIN), high * (1 - MARGIN)];
    const sides = [[right, wide, wide], [up, free, Math.min(free, high * belowButtons())]];
    const spans = sides.map(([axis, slopeLow, slopeTop]) => {
      let [low, top] = [-Infinity, -Infinity];
      for (const p of all) {
        const [along, depth] = [p.clone().sub(centre).dot(axis), p.clone().sub(centre).dot(direction)];
        top = Math.max(top, along + slopeTop * depth);
        low = Math.max(low, -along + slopeLow * depth);
      }
      const least = (top + low) / (slopeTop + slopeLow);
      return { least, shift: (d) => (top - low + (slopeLow - slopeTop) * d) / 2 };
    });
    const distance = Math.max(...spans.map(({ least }) => least), 1e-6);
    const target = centre.addScaledVector(right, spans[0].shift(distance))
      .addScaledVector(up, spans[1].shift(distance));
    const reach = Math.max(...all.map((p) => p.distanceTo(target)));
    const position = target.clone().addScaledVector(direction, distance);
    camera.near = Math.max(distance - 3 * reach, 0.01 * distance);
    camera.far = 100 * (distance + reach);
    camera.updateProjectionMatrix();
    controls.target.copy(target);
    camera.position.copy(position);
    controls.update();
    viewer.set_dirty();
    drawRuler();
  }

  /* Frames the robot again when it has left the view, unless the camera was turned by hand. */
  function keep() {
    if (moved) return;
    camera.updateMatrixWorld();
    const out = (p) => {
      p.project(camera);
      return Math.max(Math.abs(p.x), Math.abs(p.y)) > 1;
    };
    if (points().some(out)) fit();
  }

  function look(name) {
    direction = inertial(...(PRESETS[name] ?? view)).normalize();
    fit();
  }

  function drawRuler() {
    const height = viewer.renderer.domElement.clientHeight || 1;
    const distance = camera.position.distanceTo(controls.target);
    const metre = height / (2 * Math.tan((camera.fov * Math.PI) / 360) * distance);
    const power = 10 ** Math.floor(Math.log10(120 / metre));
    const length = [5, 2, 1].find((factor) => factor * power * metre <= 120) * power;
    byId("scale").style.width = `${length * metre}px`;
    byId("scale").textContent = `${digits(length)} m`;
    camera.updateMatrixWorld();
    const lines = ["x", "y", "z"].map((name, i) => {
      const unit = [0, 1, 2].map((k) => Number(k === i));
      const axis = inertial(...unit).transformDirection(camera.matrixWorldInverse);
      const [x, y] = [26 + 17 * axis.x, 26 - 17 * axis.y];
      const [a, b] = [26 + 23 * axis.x, 26 - 23 * axis.y];
      return `<line x1="26" y1="26" x2="${x}" y2="${y}" class="${name}"/>`
        + `<text x="${a}" y="${b + 3}">${name}</text>`;
    });
    byId("compass").innerHTML = `<svg viewBox="0 0 52 52" aria-hidden="true">${lines.join("")}</svg>`;
    drawTicks();
  }

  let last = "";
  new ResizeObserver(() => {
    viewer.set_3d_pane_size();
    const size = `${camera.aspect}`;
    if (!moved && last !== size) fit();
    else drawRuler();
    last = size;
  }).observe(byId("scene"));
  for (const button of byId("view").querySelectorAll("[data-view]")) {
    button.addEventListener("click", () => look(button.dataset.view));
  }
  return { fit, keep, points, take: (all) => fit((whole = all)) };
}
