/* The readouts, the same on the live page and in saved ones. */

import { DEGREE, byId, digits, distanceColour, element, fixed } from "./format.js";

const FAR = 30; // degrees at the end of the gauge

export function createReadouts({ model, tip, tip_reason, task, unit, joints, meaning, missing,
  contacts, wheels, grid }) {
  byId("squares").textContent = `grid ${digits(grid.step)} m`;
  byId("model").textContent = byId("model").title = model;
  document.title = `${model} - spacearm`;
  byId("tipname").textContent = tip;
  byId("tipname").title = `The link whose motion counts: ${tip_reason}.`;
  byId("unit").textContent = `[${unit}], task ${task.join(" ")}`;
  byId("meaning").textContent = meaning;
  byId("missing").querySelector("p").textContent = missing;
  byId("missing").hidden = !missing;
  byId("contacts").title = contacts;
  byId("wheels").hidden = !wheels.rows.length;
  table(byId("wheels").querySelector("div"), wheels.head, wheels.rows);
  return (state) => show(state, { joints, task, unit });
}

function show(state, { joints, task, unit }) {
  setKind(state, state.impossible && "impossible task");
  gauge(state.distance);
  byId("judged").textContent = `(${state.spacecraft})`;
  byId("away").textContent = state.impossible
    || (state.away ? `To get away, per degree: ${state.away}` : "");
  byId("radius").textContent = `${digits(state.radius, 5)} m`;
  byId("tip").textContent = `${state.tip.map((x) => fixed(x, 3)).join(", ")} m`;
  const touching = state.contacts.map((pair) => pair.join(" – ")).join(", ");
  byId("contacts").textContent = touching ? `Bodies meet: ${touching}` : "";
  byId("outside").textContent = state.outside.length
    ? `Outside its limits: ${state.outside.join(", ")}` : "";
  byId("sigma_min").textContent = `${digits(state.sigma_min, 4, state.error)} ${unit}`;
  byId("condition").textContent =
    state.sigma_min <= state.error ? "∞" : digits(state.condition);
  byId("rank").textContent = `${state.rank} of ${state.sigma.length}`;
  bars(state.sigma, state.error);
  directions(state, task);
  explain(state.legend, state.hidden);
  gradient(state.gradient, joints);
}

export function setKind({ kind, near }, words = "") {
  const text = words || (kind === "regular" ? (near ? "near singular" : "regular")
    : `${kind} singularity`);
  byId("kind").textContent = text;
  byId("kind").className = `badge ${near ? "near" : kind}`;
}

export function gauge(distance) {
  const box = byId("gauge");
  const degrees = distance === null ? Infinity : distance / DEGREE;
  const shown = Math.min(degrees, FAR);
  box.firstElementChild.style.left = `${(100 * shown) / FAR}%`;
  box.setAttribute("aria-valuenow", shown.toFixed(2));
  const text = distance === null ? "none found"
    : `${digits(degrees, 3)}° away`;
  byId("distance").textContent = text;
  box.setAttribute("aria-valuetext", text);
  box.style.background = `linear-gradient(to right, ${[0, 0.25, 0.5, 0.75, 1]
    .map((x) => `rgb(${distanceColour(x).join(" ")})`).join(", ")})`;
}

function bars(sigma, error) {
  const box = byId("bars");
  while (box.children.length < sigma.length) {
    const row = element("div", "", "bar");
    row.append(element("div"), element("span"));
    box.append(row);
  }
  sigma.forEach((value, i) => {
    const [bar, number] = box.children[i].children;
    bar.style.width = `${(100 * value) / (sigma[0] || 1)}%`;
    number.textContent = digits(value, 4, error);
  });
}

function table(box, head, rows) {
  const made = document.createElement("table");
  const top = made.createTHead().insertRow();
  for (const text of head) top.append(Object.assign(element("th", text), { scope: "col" }));
  const body = made.createTBody();
  for (const [name, ...cells] of rows) {
    const row = body.insertRow();
    row.append(Object.assign(element("th", name), { scope: "row" }));
    row.className = name;
    for (const cell of cells) row.insertCell().textContent = cell;
  }
  box.replaceChildren(made);
}

function directions(state, task) {
  const rows = state.directions.map((row, i) =>
    [i < state.rank ? "available" : "lost", ...row.map((x) => fixed(x, 2))]);
  table(byId("directions"), ["tip", ...task], rows);
}

/* What the colours of workspaces and risk mean, as long as their layer is shown. */
function explain(keys, hidden) {
  byId("legend").replaceChildren(...keys.filter(({ layer }) => !hidden.includes(layer))
    .map(({ colors, words }) => {
      const row = element("div", "", "key");
      const swatch = element("span");
      swatch.style.background = `linear-gradient(to right, ${colors.length > 1 ? colors
        : [colors[0], colors[0]]})`;
      row.append(swatch, element("span", words));
      return row;
    }));
}

function gradient(slopes, joints) {
  table(byId("gradient"), ["joint", "∂σmin/∂q"],
    joints.map(({ label }, i) => [label, digits(slopes[i], 3, 1e-9)]));
}
