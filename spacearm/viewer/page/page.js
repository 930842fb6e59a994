/* The panel: sends what is moved, shows what comes back. One WebSocket carries the drawing (binary)
   and the panel's messages (JSON). */

import { createViewer, legend, timeControls } from "./scene.js";

const byId = (id) => document.getElementById(id);
const viewer = createViewer(byId("scene"));
const DEGREE = Math.PI / 180;
const controls = []; // per joint: { slider, number, factor }
let about = null;
let readout = null;
let showTime = () => {};
let socket = null;

/* --- the connection: one request under way, of each kind only the latest waits --- */

const waiting = new Map();
let underWay = 0;

function ask(message, key = message.do) {
  waiting.set(key, message);
  flush();
}

function flush() {
  if (underWay || !waiting.size || socket?.readyState !== WebSocket.OPEN) return;
  const [key, message] = waiting.entries().next().value;
  waiting.delete(key);
  underWay = performance.now();
  socket.send(JSON.stringify(message));
}

function connect() {
  socket = new WebSocket(`ws://${location.host}/socket${location.search}`);
  socket.binaryType = "arraybuffer";
  socket.addEventListener("message", ({ data }) => {
    if (typeof data === "string") receive(JSON.parse(data));
    else viewer.handle_command_bytearray(new Uint8Array(data));
  });
  socket.addEventListener("close", () => {
    underWay = 0;
    setKind("disconnected", "");
    setTimeout(reconnect, 1000);
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
  if (message.about && !about) build((about = message.about));
  if (message.error) complain(message.error);
  if (message.complete) document.body.dataset.ready = "yes";
  if (message.readout) {
    underWay = 0;
    show((readout = message.readout));
    flush();
  }
}

/* --- the panel's parts, once --- */

function build({ model, task, unit, joints, layers, motion, meaning, missing }) {
  byId("model").textContent = model;
  document.title = `${model} - spacearm`;
  byId("unit").textContent = `[${unit}], task ${task.join(" ")}`;
  byId("meaning").textContent = meaning;
  byId("missing").textContent = `Not drawn, files not found: ${missing}`;
  byId("missing").hidden = !missing;
  joints.forEach(buildJoint);
  legend(byId("layers"), layers, (name, visible) =>
    ask({ do: "layer", name, visible }, `layer ${name}`));
  if (motion) showTime = timeControls(byId("motion"), motion, (t) => ask({ do: "time", t }));
}

function buildJoint({ name, angle, lower, upper }, index) {
  const factor = angle ? DEGREE : 1;
  const row = document.createElement("div");
  row.className = "joint";
  const label = document.createElement("span");
  label.textContent = label.title = name;
  const [slider, number] = ["range", "number"].map((type) => {
    const input = document.createElement("input");
    const step = type === "range" ? "any" : angle ? 1 : 0.01;
    Object.assign(input, { type, min: lower / factor, max: upper / factor, step });
    input.setAttribute("aria-label", `${name} ${angle ? "in degrees" : "in metres"}`);
    return input;
  });
  slider.step = (upper - lower) / factor / 3600; // arrow keys move by a tenth of a degree of 360
  const unit = document.createElement("span");
  unit.className = "unit";
  unit.textContent = angle ? "°" : "m";
  slider.addEventListener("input", () => moveJoint(index, slider.value * factor));
  number.addEventListener("change", () => moveJoint(index, number.value * factor));
  row.append(label, slider, number, unit);
  byId("joints").append(row);
  controls.push({ slider, number, factor });
}

function moveJoint(index, value) {
  complain("");
  ask({ do: "joint", index, value }, `joint ${index}`);
}

for (const button of document.querySelectorAll("[data-do]")) {
  button.addEventListener("click", () => ask({ do: button.dataset.do }));
}
for (const radio of document.querySelectorAll("[name=mode]")) {
  radio.addEventListener("change", () => ask({ do: "mode", mode: radio.value }));
}
const angles = [...byId("attitude").querySelectorAll("input")];
for (const input of angles) {
  input.addEventListener("change", () =>
    ask({ do: "attitude", rpy: angles.map((angle) => Number(angle.value) * DEGREE) }));
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

/* --- what comes back --- */

function digits(x, n = 4) {
  if (x === null) return "∞";
  const plain = x === 0 || (Math.abs(x) >= 1e-3 && Math.abs(x) < 1e6);
  return plain ? Number(x.toPrecision(n)).toString() : x.toExponential(2);
}

function show(state) {
  setKind(state.kind === "regular" ? "regular" : `${state.kind} singularity`, state.kind);
  state.q.forEach((value, i) => {
    const { slider, number, factor } = controls[i];
    if (document.activeElement !== slider || !waiting.has(`joint ${i}`)) {
      if (document.activeElement !== slider) slider.value = value / factor;
      if (document.activeElement !== number) number.value = (value / factor).toFixed(2);
    }
  });
  angles.forEach((input, i) => {
    if (document.activeElement !== input) input.value = (state.attitude[i] / DEGREE).toFixed(2);
    input.disabled = state.mode !== "posture";
  });
  document.querySelector(`[name=mode][value="${state.mode}"]`).checked = true;
  gauge(state.distance, state.away);
  bars(state.sigma);
  byId("sigma_min").textContent = `${digits(state.sigma_min)} ${about.unit}`;
  byId("condition").textContent = digits(state.condition);
  byId("rank").textContent = `${state.rank} of ${state.sigma.length}`;
  byId("radius").textContent = `${digits(state.radius, 5)} m`;
  byId("tip").textContent = `${state.tip.map((x) => x.toFixed(3)).join(", ")} m`;
  for (const box of document.querySelectorAll("[data-layer]")) {
    box.checked = !state.hidden.includes(box.dataset.layer);
  }
  showTime(state.t);
}

function gauge(distance, away) {
  const box = byId("gauge");
  const most = Number(box.getAttribute("aria-valuemax"));
  const degrees = distance === null ? Infinity : distance / DEGREE;
  const shown = Math.min(degrees, most);
  box.firstElementChild.style.left = `${(100 * shown) / most}%`;
  box.setAttribute("aria-valuenow", shown.toFixed(2));
  const text = degrees >= most ? `over ${most}°` : `${degrees < 1e-3 ? 0 : digits(degrees, 3)}°`;
  byId("distance").textContent = text;
  box.setAttribute("aria-valuetext", text);
  byId("away").textContent = away ? `To get away, per degree: ${away}` : "";
}

function bars(sigma) {
  const box = byId("bars");
  while (box.children.length < sigma.length) {
    const row = document.createElement("div");
    row.className = "bar";
    row.append(document.createElement("div"), document.createElement("span"));
    box.append(row);
  }
  sigma.forEach((value, i) => {
    const [bar, number] = box.children[i].children;
    bar.style.width = `${(100 * value) / (sigma[0] || 1)}%`;
    number.textContent = digits(value);
  });
}

function setKind(text, kind) {
  byId("kind").textContent = text;
  byId("kind").className = `badge ${kind}`;
}

function complain(text) {
  byId("error").textContent = text;
  byId("error").hidden = !text;
}

connect();
window.spacearm = { viewer };
