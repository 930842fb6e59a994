/* The tip is dragged in the drawing: by its handle in the plane of the view (or that of a planar
   arm), by a ring about an axis of the task. The arrow keys do the same. */

import { byId } from "./format.js";
import { pointUnder, toDrawing as world, toInertial as inertial } from "./scene.js";

const SVG = "http://www.w3.org/2000/svg";
const RING = 60; // px
const AXES = ["#d62728", "#00914d", "#3f6ff0"];

/* `pull` is called with where the tip is pulled to, `onEnd` when it is let go. */
export function createGrab(viewer, { task, normal }, pull, onEnd) {
  const box = byId("grab");
  if (!viewer || !task.length) return { isHeld: () => false, show() {} };
  const { Vector3, Plane } = MeshCat.THREE;
  const { camera, controls } = viewer;
  const slides = task.some((row) => "xyz".includes(row));
  const turns = ["rx", "ry", "rz"].flatMap((row, i) => (task.includes(row) ? [i] : []));
  let [state, held, framing] = [null, null, false];
  let [width, height] = [1, 1]; // px

  const make = (tag, words) => {
    const node = document.createElementNS(SVG, tag);
    if (words) {
      node.setAttribute("tabindex", "0");
      node.setAttribute("role", "button");
      node.setAttribute("aria-label", words);
      node.append(document.createElementNS(SVG, "title"));
      node.firstChild.textContent = words;
    }
    box.append(node);
    return node;
  };
  const link = make("line");
  const rings = turns.map((i) => {
    const ring = make("polyline", `Turn the tip about the ${"xyz"[i]} axis: drag, or arrow keys.`);
    ring.style.setProperty("--axis", AXES[i]);
    return { i, ring };
  });
  const handle = slides ? make("circle", "Pull the tip: drag, or arrow keys.") : null;

  const scale = () => { // metres of a pixel at the tip
    const depth = world(state.tip).sub(camera.position).dot(camera.getWorldDirection(new Vector3()));
    return (2 * depth * Math.tan((camera.fov * Math.PI) / 360)) / height;
  };

  function pixel(point) {
    const p = point.clone().project(camera);
    return [((p.x + 1) / 2) * width, ((1 - p.y) / 2) * height];
  }

  const under = (event, plane) => pointUnder(viewer, event, plane);

  function draw() {
    if (!state) return;
    camera.updateMatrixWorld();
    const tip = world(state.tip);
    const [x, y] = pixel(tip);
    box.classList.toggle("blocked", Boolean(state.blocked));
    box.classList.toggle("held", Boolean(held));
    if (handle) set(handle, { cx: x, cy: y, r: 13 });
    const radius = RING * scale();
    for (const { i, ring } of rings) {
      const axis = world(state.axes[i]).normalize();
      const [u, v] = across(axis);
      const points = Array.from({ length: 49 }, (_, k) => {
        const angle = (Math.PI * k) / 24;
        return pixel(tip.clone().addScaledVector(u, radius * Math.cos(angle))
          .addScaledVector(v, radius * Math.sin(angle))).join();
      });
      ring.setAttribute("points", points.join(" "));
    }
    const goal = held?.at && state.blocked ? pixel(held.at) : [x, y];
    set(link, { x1: x, y1: y, x2: goal[0], y2: goal[1] });
  }

  /* Draws once a frame, however often the posture changes. */
  function drawSoon() {
    if (framing) return;
    framing = true;
    requestAnimationFrame(() => {
      framing = false;
      draw();
    });
  }

  const set = (node, values) =>
    Object.entries(values).forEach(([name, value]) => node.setAttribute(name, value));

  function across(axis) {
    const u = new Vector3(...(Math.abs(axis.x) < 0.7 ? [1, 0, 0] : [0, 1, 0])).cross(axis).normalize();
    return [u, axis.clone().cross(u)];
  }

  function begin(event, node, plane, follow) {
    const from = under(event, plane);
    if (!from) return;
    event.preventDefault();
    node.focus({ preventScroll: true, focusVisible: false });
    node.setPointerCapture(event.pointerId);
    const grip = Math.random(); // the server takes the tip's pose at the first pull of each grip
    held = { at: null };
    node.classList.add("pulled");
    const onMove = (moved) => {
      const to = under(moved, plane);
      if (!to) return;
      pull({ ...follow(from, to), grip });
      draw();
    };
    const letGo = () => {
      node.removeEventListener("pointermove", onMove);
      node.classList.remove("pulled");
      held = null;
      draw();
      onEnd();
    };
    node.addEventListener("pointermove", onMove);
    node.addEventListener("pointerup", letGo, { once: true });
    node.addEventListener("pointercancel", letGo, { once: true });
  }

  handle?.addEventListener("pointerdown", (event) => {
    const tip = world(state.tip);
    const facing = normal ? world(normal) : camera.getWorldDirection(new Vector3());
    const plane = new Plane().setFromNormalAndCoplanarPoint(facing, tip);
    begin(event, handle, plane, (from, to) => {
      const shift = to.clone().sub(from);
      held.at = tip.clone().add(shift);
      return { shift: inertial(shift) };
    });
  });
  for (const { i, ring } of rings) {
    ring.addEventListener("pointerdown", (event) => {
      const tip = world(state.tip);
      const axis = world(state.axes[i]).normalize();
      const plane = new Plane().setFromNormalAndCoplanarPoint(axis, tip);
      begin(event, ring, plane, (from, to) => {
        const [a, b] = [from.clone().sub(tip), to.clone().sub(tip)];
        const angle = Math.atan2(a.clone().cross(b).dot(axis), a.dot(b));
        return { turn: inertial(axis.clone().multiplyScalar(angle)) };
      });
    });
    ring.addEventListener("keydown", (event) => {
      const sign = { ArrowLeft: 1, ArrowUp: 1, ArrowRight: -1, ArrowDown: -1 }[event.key];
      if (!sign) return;
      event.preventDefault();
      pull({ turn: state.axes[i].map((x) => (x * sign * Math.PI) / 90), grip: Math.random() });
    });
  }
  handle?.addEventListener("keydown", (event) => {
    const [x, y] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[
      event.key] ?? [0, 0];
    if (!x && !y) return;
    event.preventDefault();
    const side = new Vector3().setFromMatrixColumn(camera.matrixWorld, 0).multiplyScalar(x);
    const shift = side.addScaledVector(new Vector3().setFromMatrixColumn(camera.matrixWorld, 1), y);
    pull({ shift: inertial(shift.multiplyScalar(10 * scale())), grip: Math.random() });
  });
  controls.addEventListener("change", draw);
  new ResizeObserver(([{ contentRect }]) => {
    [width, height] = [contentRect.width || 1, contentRect.height || 1];
    drawSoon();
  }).observe(box);
  return {
    isHeld: () => held !== null,
    show(told) {
      state = told;
      drawSoon();
    },
  };
}
