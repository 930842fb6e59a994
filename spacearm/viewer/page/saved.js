/* A saved page: the drawing, its values and its motion, without a server or a network. */

import { createCamera } from "./camera.js";
import { createChart } from "./chart.js";
import { DEGREE, byId, digits, element, fixed } from "./format.js";
import { createMap } from "./map.js";
import { createPlayback } from "./playback.js";
import { createReadouts, gauge, setKind } from "./readouts.js";
import { createRecorder } from "./record.js";
import { createViewer, legend } from "./scene.js";
import { explainByTouch } from "./touch.js";

const GROUND = 0xe8ecf0; // of the pictures of a motion
const INK = "#1f2933"; // of the legend on it
const PLAIN = ["grid", "bodies"]; // layers that explain themselves
const MOMENTS = 24;

function start({ about, readout, maps }, commands) {
  const viewer = createViewer(byId("scene"));
  for (const text of viewer ? commands : []) {
    viewer.handle_command_bytearray(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)));
  }
  const show = createReadouts(about);
  const camera = createCamera(viewer, about);
  legend(byId("layers"), about.layers, readout.hidden, (name, on) => {
    viewer?.set_property(["spacearm", name], "visible", on);
  });
  show(readout);
  list(about.joints, readout.q);
  const film = createRecorder(viewer, about.model);
  const trace = maps.length ? createTrace(about.joints, maps) : () => {};
  trace(readout.q, maps[0]?.t);
  const seek = about.motion ? play(viewer, about, film, trace) : null;
  const [, width, height, times] = /^#frames=(\d+),(\d+),([-+.e\d,]+)$/.exec(location.hash) ?? [];
  if (times || location.hash === "#picture") document.body.classList.add("picture");
  const size = { flex: "none", width: `${width}px`, height: `${height}px` };
  for (const id of times ? ["upper", "drawing"] : []) Object.assign(byId(id).style, size);
  viewer?.set_3d_pane_size();
  if (viewer && seek) camera.take(alongMotion(about.motion.span, seek, camera.points));
  else camera.fit();
  window.spacearm = { viewer, points: () => camera.points() };
  if (times && viewer && seek) {
    takeFrames(viewer, times.split(",").map(Number), seek, keysOf(viewer, about.layers, readout));
  }
}

/* What is to be seen of a motion from its start to its end. */
function alongMotion([first, last], seek, points) {
  const moments = Array.from({ length: MOMENTS + 1 }, (_, i) => last + ((first - last) * i) / MOMENTS);
  return moments.flatMap((t) => {
    seek(t);
    return points();
  });
}

/* What the colours in the pictures of a motion mean: of layers that show something, and of values. */
function keysOf(viewer, layers, { hidden, legend }) {
  const shown = Object.entries(layers).filter(([name]) => {
    let drawn = false;
    viewer.scene_tree.find(["spacearm", name]).object.traverse(({ geometry }) => {
      drawn ||= Boolean(geometry);
    });
    return drawn && !hidden.includes(name) && !PLAIN.includes(name);
  });
  return [
    ...shown.map(([words, colour]) => ({ colors: [colour], words })),
    ...legend.filter(({ layer }) => !hidden.includes(layer)),
  ];
}

/* Draws the legend into a corner of a picture. */
function drawKeys(canvas, keys) {
  const context = canvas.getContext("2d");
  const size = Math.round(Math.min(Math.max(canvas.height / 45, 9), 16));
  context.font = `${size}px sans-serif`;
  context.textBaseline = "middle";
  keys.forEach(({ colors, words }, i) => {
    const y = size * (1 + 1.5 * i);
    colors.forEach((colour, k) => {
      context.fillStyle = colour;
      context.fillRect(size + (k * 2 * size) / colors.length, y - size / 2, (2 * size) / colors.length, size);
    });
    context.fillStyle = INK;
    context.fillText(words, 3.5 * size, y);
  });
}

/* Tells the console the pictures of a motion at some times, for a program that reads it: in pieces, as
   the lines of several processes would mix if they were longer. Without a graphics processor smooth
   edges, a shaded ground and the far sides of bodies take most of the time; they are left out. */
function takeFrames(viewer, times, seek, keys) {
  const { FrontSide, WebGLRenderer } = MeshCat.THREE;
  const { width, height } = viewer.renderer.domElement;
  viewer.renderer.dispose();
  viewer.renderer = new WebGLRenderer({ alpha: false });
  viewer.renderer.setSize(width, height);
  viewer.renderer.setClearColor(GROUND);
  viewer.hide_background();
  viewer.scene.traverse(({ geometry, material }) => {
    if (material && geometry.type !== "BufferGeometry") material.side = FrontSide;
  });
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  for (const t of times) {
    seek(t);
    viewer.render();
    canvas.getContext("2d").drawImage(viewer.renderer.domElement, 0, 0, width, height);
    drawKeys(canvas, keys);
    const picture = canvas.toDataURL("image/png").split(",")[1];
    for (const piece of `${picture}!`.match(/.{1,3000}/g)) console.info(`picture ${piece}`);
  }
}

function list(joints, q) {
  const box = byId("joints");
  box.closest("section").classList.remove("live");
  box.closest("section").querySelectorAll("fieldset, .buttons").forEach((part) => part.remove());
  joints.forEach(({ label, name, angle }, i) => {
    const row = element("div", "", "joint");
    const title = element("span", label, "name");
    title.title = name;
    row.append(title, element("output", angle ? fixed(q[i] / DEGREE, 2) : fixed(q[i], 3)),
      element("span", angle ? "°" : "m", "unit"));
    box.append(row);
  });
}

/* The recorded map nearest in time, with the posture in it: to be seen, not to be dragged. */
function createTrace(joints, maps) {
  for (const id of ["map", "mapfold"]) byId(id).classList.remove("live");
  const { draw, show } = createMap(joints, () => {}, () => {});
  document.querySelectorAll("#map select").forEach((pick) => (pick.disabled = true));
  const canvas = byId("mapcanvas");
  if (canvas) Object.assign(canvas, { inert: true, title: "All postures of these two joints." });
  return (q, t) => {
    const apart = ({ t: recorded }) => Math.abs(recorded - t);
    draw({ ...maps.reduce((best, each) => (apart(each) < apart(best) ? each : best)), q });
    show({ q, spacecraft: maps[0].spacecraft, box: null });
  };
}

/* Values between two samples of a curve are on the line between them. */
function at({ t, curves }, time, name) {
  const curve = curves.find((each) => each.name === name);
  let i = t.findIndex((each) => each > time) - 1;
  if (i < 0) i = time <= t[0] ? 0 : Math.max(t.length - 2, 0);
  const j = Math.min(i + 1, t.length - 1);
  const s = j > i ? Math.min(Math.max((time - t[i]) / (t[j] - t[i]), 0), 1) : 0;
  return (curve?.values ?? []).map((v) =>
    (v[i] === null || v[j] === null ? null : (1 - s) * v[i] + s * v[j]));
}

function play(viewer, { motion, joints, near, tolerance }, film, trace) {
  viewer?.animator.play();
  viewer?.animator.pause();
  let drawTime = () => {};
  const seek = (t) => {
    viewer?.animator.seek(t - motion.span[0]);
    drawTime(t);
    const degrees = at(motion, t, "distance")[0];
    gauge(degrees === null ? null : degrees * DEGREE);
    const close = degrees !== null && degrees * DEGREE < near;
    const singular = degrees !== null && degrees * DEGREE < tolerance;
    setKind({ kind: singular ? "dynamic" : "regular", near: close && !singular },
      singular ? "singular" : "");
    const place = at(motion, t, "tip");
    if (place.length) byId("tip").textContent = `${place.map((x) => fixed(x, 3)).join(", ")} m`;
    byId("radius").textContent = `${digits(at(motion, t, "R from the CM")[0], 5)} m`;
    document.body.classList.toggle("played", t !== motion.span[0]); // known for the start alone
    const [turning, sliding] = ["joints", "sliding joints"].map((name) => at(motion, t, name));
    const outputs = byId("joints").querySelectorAll("output");
    const q = joints.map(({ angle }, i) => {
      const value = angle ? turning.shift() : sliding.shift();
      outputs[i].textContent = fixed(value, angle ? 2 : 3);
      return angle ? value * DEGREE : value;
    });
    trace(q, t);
  };
  const playback = createPlayback(seek);
  const chart = createChart(playback.seek);
  drawTime = chart.show;
  chart.load(motion);
  playback.load(motion);
  film(playback, async (t) => playback.seek(t));
  return playback.seek;
}

explainByTouch();
start(DATA, COMMANDS);
