/* The live page: one WebSocket carries the drawing (binary) and the panel's messages (JSON). */

import { createCamera } from "./camera.js";
import { createChart } from "./chart.js";
import { createChoices } from "./choices.js";
import { createFly } from "./fly.js";
import { DEGREE, byId, fixed } from "./format.js";
import { createGrab } from "./grab.js";
import { createJoints, refuse } from "./joints.js";
import { createMap } from "./map.js";
import { createPlayback } from "./playback.js";
import { createPoses } from "./poses.js";
import { createReadouts, setKind } from "./readouts.js";
import { createRecorder } from "./record.js";
import { createViewer, legend } from "./scene.js";
import { explainByTouch } from "./touch.js";
import { createWaiting, createWork } from "./work.js";

const viewer = createViewer(byId("scene"));
let [about, readout, socket, camera, joints, showState, map, grab, choices, playback, chart] = [];
let [showWork, showFlight] = [];
let [played, drawn, asked, wanted] = [null, null, 0, null];
const poses = createPoses(viewer);
const showWaiting = createWaiting();
const MOMENT = 100; // ms between the moments of a motion in play that the server answers for

/* --- the connection: one request under way, of each kind only the latest waits --- */

const waiting = new Map();
let underWay = null;

function ask(message, key = message.do) {
  waiting.set(key, message);
  flush();
}

function flush() {
  if (underWay || !waiting.size || socket?.readyState !== WebSocket.OPEN) return;
  const [key, message] = waiting.entries().next().value;
  waiting.delete(key);
  showWaiting((underWay = message));
  socket.send(JSON.stringify(message));
}

function connect() {
  socket = new WebSocket(`ws://${location.host}/socket${location.search}`);
  socket.binaryType = "arraybuffer";
  socket.addEventListener("message", ({ data }) => {
    if (typeof data === "string") receive(JSON.parse(data));
    else draw(data);
  });
  socket.addEventListener("close", () => {
    showWaiting((underWay = null));
    setKind({ kind: "" }, "disconnected");
    setTimeout(reconnect, 1000);
  });
}

let framing = false;

/* Draws what came, commands each after its length, and has the camera look once a frame whether the
   robot is still in view. */
function draw(commands) {
  const lengths = new DataView(commands);
  for (let at = 0, end; at < commands.byteLength; at = end) {
    end = at + 4 + lengths.getUint32(at, true);
    viewer?.handle_command_bytearray(new Uint8Array(commands.slice(at + 4, end)));
  }
  if (isMoving()) poses.show(playback.at());
  if (framing || !document.body.dataset.ready || grab.isHeld()) return;
  framing = true;
  requestAnimationFrame(() => {
    framing = false;
    camera.keep();
  });
}

/* Another server may have taken the port: it does not know this page's token, and says so. */
async function reconnect() {
  try {
    const { status } = await fetch(location.href, { cache: "no-store" });
    if (status === 403) location.reload();
    else connect();
  } catch {
    setTimeout(reconnect, 1000);
  }
}

function receive(message) {
  if (message.about && !about) build((about = message.about), message.readout);
  if (message.map) map.draw(message.map);
  if ("motion" in message) load(message.motion);
  if (message.poses) poses.load(message.poses);
  if (message.error) complain(message.error);
  if (message.readout && message.readout.edition !== about.edition) {
    location.reload(); // another arm is shown now
    return;
  }
  if (message.readout) {
    showWaiting((underWay = null));
    show((readout = message.readout));
    flush();
  }
  if (drawn && message.drawn === drawn.t) {
    drawn.done();
    drawn = null;
  }
  if (message.complete) {
    camera.fit();
    document.body.dataset.ready = "yes";
    choices.restore();
    // A notebook of this machine (none else may frame the page) brings the frame back by its address.
    if (window.parent !== window) window.parent.postMessage({ spacearm: location.href }, "*");
  }
}

/* --- the panel's parts, once --- */

function build(told, { hidden, played: already }) {
  played = already;
  showState = createReadouts(told);
  camera = createCamera(viewer, told);
  joints = createJoints(told.joints, (index, value) => {
    complain("");
    ask({ do: "joint", index, value }, `joint ${index}`);
  });
  map = createMap(told.joints, ask, (indices, values) => ask({ do: "joints", indices, values }));
  choices = createChoices(told, ask, complain, () => readout);
  grab = createGrab(viewer, told, (pull) => ask({ do: "grab", ...pull }), camera.keep);
  legend(byId("layers"), told.layers, hidden, (name, visible) =>
    ask({ do: "layer", name, visible }, `layer ${name}`));
  showWork = createWork(viewer, told, ask);
  showFlight = createFly(ask, told.fly);
  const film = createRecorder(viewer, told.model);
  playback = createPlayback(play);
  chart = createChart(playback.seek);
  film(playback, (t) => new Promise((done) => {
    drawn = { t, done };
    playback.seek(t);
  }));
  byId("compare").addEventListener("change", ({ target }) =>
    ask({ do: "compare", with: target.value }));
  load(told.motion);
}

/* In play the page moves the drawing itself, once it knows the poses, and asks for the rest now and
   then. */
function play(t, playing) {
  if (playing && wanted !== played) {
    wanted = played;
    ask({ do: "poses" });
  }
  if (playing && poses.of() === played) {
    poses.show(t);
    chart.show(t);
    if (performance.now() - asked < MOMENT) return;
  }
  asked = performance.now();
  ask({ do: "time", t });
}

const isMoving = () => playback?.at() != null && poses.of() === played;

/* A motion to be played, with its curves and what it can be compared with. */
function load(motion) {
  chart.load(motion);
  playback.load(motion);
  document.querySelector("#attitudepath [value=motion]").textContent =
    motion?.momentum ? "the motion, without its momentum" : "the motion";
  const compare = byId("compare");
  compare.replaceChildren(new Option("nothing", ""));
  for (const [words, way] of Object.entries(motion?.ways ?? {})) {
    compare.append(new Option(words, way, false, words === motion.compared));
  }
}

for (const button of document.querySelectorAll("[data-do]")) {
  button.addEventListener("click", () => {
    complain("");
    button.setAttribute("aria-busy", "true");
    ask({ do: button.dataset.do });
  });
}
for (const radio of document.querySelectorAll("[name=mode]")) {
  radio.addEventListener("change", () => ask({ do: "mode", mode: radio.value }));
}
byId("spacecraft").addEventListener("change", ({ target }) =>
  ask({ do: "spacecraft", mode: target.value }));
const angles = [...byId("attitude").querySelectorAll("input")];
for (const [i, input] of angles.entries()) {
  input.addEventListener("change", () => {
    if (input.value === "" || Math.abs(input.valueAsNumber) > 360) {
      refuse(byId("attitude"), "give an angle from −360° to 360°");
      input.value = fixed(readout.attitude[i] / DEGREE, 2);
      return;
    }
    refuse(byId("attitude"), "");
    ask({ do: "attitude", rpy: angles.map((angle) => Number(angle.value) * DEGREE) });
  });
}
byId("copy").addEventListener("click", async () => {
  try {
    await navigator.clipboard.writeText(readout.python);
    byId("copy").textContent = "Copied";
  } catch {
    complain("the browser does not allow copying");
  }
  setTimeout(() => (byId("copy").textContent = "Copy as Python"), 1500);
});
byId("fold").addEventListener("click", () => {
  const folded = document.body.classList.toggle("folded");
  byId("fold").setAttribute("aria-expanded", String(!folded));
});

/* --- what comes back --- */

function show(state) {
  showState(state);
  joints.show(state.q, (index) => waiting.has(`joint ${index}`));
  joints.mark(state.box);
  angles.forEach((input, i) => {
    if (document.activeElement !== input) input.value = fixed(state.attitude[i] / DEGREE, 2);
    input.disabled = state.mode !== "posture" && state.spacecraft === "free-floating";
  });
  document.querySelector(`[name=mode][value="${state.mode}"]`).checked = true;
  byId("spacecraft").value = state.spacecraft;
  byId("modes").disabled = state.spacecraft !== "free-floating";
  for (const box of document.querySelectorAll("[data-layer]")) {
    box.checked = !state.hidden.includes(box.dataset.layer);
  }
  for (const button of document.querySelectorAll("[data-do][aria-busy]")) {
    button.removeAttribute("aria-busy");
  }
  byId("note").textContent = state.note;
  byId("blocked").textContent = state.blocked;
  map.show(state);
  grab.show(state);
  showWork(state);
  showFlight(state);
  playback.show(state.t);
  if (!isMoving()) chart.show(state.t);
  if (state.played !== played) ask({ do: "motion" });
  played = state.played;
}

function complain(text) {
  byId("error").textContent = text;
}

explainByTouch();
connect();
window.spacearm = { viewer, points: () => camera.points() };
