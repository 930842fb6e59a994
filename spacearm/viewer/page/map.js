/* The map of two joints: coloured by the distance to the singular set, with the singular curves and
   the posture as a point that can be dragged, or moved by the arrow keys. */

import { DEGREE, byId, distanceColour, element, fixed } from "./format.js";

const TURN = 2 * Math.PI;
const EDGE = { left: 34, right: 8, top: 8, bottom: 22 }; // px around the map
const REST = 10; // ms without a change after which the map is asked for
const LATEST = 60; // ms after the first change in which it is asked for in any case
const SHARE = 2; // a map is asked for again after so many times as long as the last one took
const MEMORY = { willReadFrequently: true }; // kept off the graphics card, whose work would be waited for
const wrapped = (angle) => angle - TURN * Math.round(angle / TURN);

export function createMap(joints, ask, move) {
  const turning = joints.flatMap(({ angle }, i) => (angle ? [i] : []));
  if (turning.length < 2) {
    byId("map").remove();
    byId("mapfold").remove();
    return { show() {}, draw() {} };
  }
  if (window.innerWidth < 1200) byId("map").toggleAttribute("data-closed", true);
  byId("mapfold").setAttribute("aria-expanded", String(window.innerWidth >= 1200));
  const canvas = byId("mapcanvas");
  const picks = [byId("map-x"), byId("map-y")];
  const picture = document.createElement("canvas");
  let [map, q, dragging, asked, timer, since, sent, took] = [null, null, false, null, 0, null, 0, 0];
  let [spacecraft, box] = ["free-floating", null];
  let [width, height, framing] = [0, 0, false]; // px, zero while the map is closed

  for (const pick of picks) {
    for (const i of turning) pick.append(new Option(joints[i].label, i));
    pick.addEventListener("change", () => {
      const other = picks[1 - picks.indexOf(pick)];
      if (other.value === pick.value) other.value = map.joints[picks.indexOf(pick)];
      ask({ do: "map", joints: picks.map(({ value }) => Number(value)) });
    });
  }

  const open = () => width > 0 && height > 0;

  function place([x, y]) {
    return [
      EDGE.left + ((x + Math.PI) / TURN) * (width - EDGE.left - EDGE.right),
      height - EDGE.bottom - ((y + Math.PI) / TURN) * (height - EDGE.top - EDGE.bottom),
    ];
  }

  function paintPicture() {
    const n = map.shares.length;
    Object.assign(picture, { width: n, height: n });
    const context = picture.getContext("2d", MEMORY);
    const image = context.createImageData(n, n);
    map.shares.forEach((row, j) => row.forEach((share, i) => {
      image.data.set([...distanceColour(share / 100), 255], 4 * ((n - 1 - j) * n + i));
    }));
    context.putImageData(image, 0, 0);
  }

  function paint() {
    if (!map || !q || !open()) return;
    const ratio = window.devicePixelRatio || 1;
    const pixels = [width, height].map((length) => Math.round(length * ratio));
    if (canvas.width !== pixels[0]) canvas.width = pixels[0];
    if (canvas.height !== pixels[1]) canvas.height = pixels[1];
    const context = canvas.getContext("2d", MEMORY);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const [[left, bottom], [right, top]] = [place([-Math.PI, -Math.PI]), place([Math.PI, Math.PI])];
    context.save();
    context.beginPath();
    context.rect(left, top, right - left, bottom - top);
    context.clip();
    context.drawImage(picture, left, top, right - left, bottom - top);
    limits(context);
    curves(context);
    ranges(context);
    context.restore();
    axes(context, left, bottom);
    point(context);
  }

  /* Paints once a frame, however often the posture changes. */
  function paintSoon() {
    if (framing) return;
    framing = true;
    requestAnimationFrame(() => {
      framing = false;
      paint();
    });
  }

  function limits(context) {
    const [x, y] = map.joints.map((i) => joints[i]);
    const [[l, b], [r, t]] = [place([x.lower, y.lower]), place([x.upper, y.upper])];
    context.beginPath();
    context.rect(-1e4, -1e4, 3e4, 3e4);
    context.rect(l, t, r - l, b - t);
    context.fillStyle = "#0006";
    context.fill("evenodd");
  }

  /* The rectangle in which no posture is singular, as long as the other joints are in their ranges. */
  function ranges(context) {
    const within = box?.ranges.every(([low, high], i) =>
      map.joints.includes(i) || (q[i] >= low && q[i] <= high));
    if (!within) return;
    const [[l, r], [b, t]] = map.joints.map((i) => box.ranges[i]);
    for (const [colour, width] of [["#fff", 4], ["#009e73", 2]]) {
      Object.assign(context, { strokeStyle: colour, lineWidth: width });
      for (const x of [-TURN, 0, TURN]) for (const y of [-TURN, 0, TURN]) {
        const [[left, bottom], [right, top]] = [place([l + x, b + y]), place([r + x, t + y])];
        context.strokeRect(left, top, right - left, bottom - top);
      }
    }
  }

  function curves(context) {
    context.lineCap = "round";
    for (const [colour, width] of [["#fff", 4], ["#111", 2]]) {
      Object.assign(context, { strokeStyle: colour, lineWidth: width });
      context.beginPath();
      for (const curve of map.curves ?? []) {
        for (let k = 1; k < curve.length; k++) {
          const [from, to] = [curve[k - 1], curve[k]];
          const start = from.map(wrapped); // each piece where the map shows it
          context.moveTo(...place(start));
          context.lineTo(...place(start.map((x, i) => x + to[i] - from[i])));
        }
      }
      context.stroke();
    }
  }

  function axes(context, left, bottom) {
    Object.assign(context, {
      fillStyle: getComputedStyle(canvas).color, font: "11px system-ui, sans-serif",
    });
    for (const degrees of [-180, -90, 0, 90, 180]) {
      context.textAlign = degrees === 180 ? "right" : "center";
      context.fillText(`${degrees}°`, place([degrees * DEGREE, 0])[0], bottom + 14);
      context.textAlign = "right";
      context.fillText(`${degrees}°`, left - 3, place([0, degrees * DEGREE])[1] + 4);
    }
  }

  function point(context) {
    const [x, y] = place(map.joints.map((i) => wrapped(q[i])));
    context.beginPath();
    context.arc(x, y, 6.5, 0, TURN);
    Object.assign(context, { fillStyle: "#d6007f", strokeStyle: "#fff", lineWidth: 2.5 });
    context.fill();
    context.stroke();
    const words = map.joints.map((i) => `${joints[i].label} ${fixed(q[i] / DEGREE, 1)}°`);
    canvas.setAttribute("aria-valuetext", words.join(", "));
  }

  function go(target) {
    const values = target.map((angle, k) => {
      const { lower, upper } = joints[map.joints[k]];
      const turns = q[map.joints[k]] - wrapped(q[map.joints[k]]);
      return Math.min(Math.max(angle + turns, lower), upper);
    });
    map.joints.forEach((i, k) => (q[i] = values[k])); // drawn at once, the answer corrects it
    move(map.joints, values);
    paint();
  }

  function under(event) {
    const { left, top } = canvas.getBoundingClientRect();
    const x = (event.clientX - left - EDGE.left) / (width - EDGE.left - EDGE.right);
    const y = 1 - (event.clientY - top - EDGE.top) / (height - EDGE.top - EDGE.bottom);
    return [x, y].map((share) => (Math.min(Math.max(share, 0), 1) - 0.5) * TURN);
  }

  canvas.addEventListener("pointerdown", (event) => {
    if (!map) return;
    dragging = true;
    canvas.setPointerCapture(event.pointerId);
    go(under(event));
  });
  canvas.addEventListener("pointermove", (event) => dragging && go(under(event)));
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, () => (dragging = false));
  }
  const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] };
  canvas.addEventListener("keydown", (event) => {
    const step = steps[event.key];
    if (!step || !map) return;
    event.preventDefault();
    const by = (event.shiftKey ? 10 : 1) * DEGREE;
    go(map.joints.map((i, k) => wrapped(q[i]) + by * step[k]));
  });
  byId("mapfold").addEventListener("click", () => {
    const on = byId("map").toggleAttribute("data-closed") === false;
    byId("mapfold").setAttribute("aria-expanded", String(on));
  });
  new ResizeObserver(([{ contentRect }]) => {
    [width, height] = [contentRect.width, contentRect.height];
    paint();
    refresh();
  }).observe(canvas);

  const held = (at, mode) =>
    [mode, ...at.map((x, i) => (map?.joints.includes(i) ? 0 : x.toFixed(6)))].join();

  /* Asks for a new map where another joint has moved since the last, at a pace that leaves the server
     time for the sliders. */
  function refresh() {
    if (!open() || !q) return;
    clearTimeout(timer);
    if (held(q, spacecraft) === asked) {
      since = null;
      paintSoon();
      return;
    }
    const now = performance.now();
    since ??= now;
    const wait = Math.max(Math.min(REST, since + LATEST - now), sent + SHARE * took - now);
    timer = setTimeout(request, wait);
  }

  function request() {
    since = null;
    asked = held(q, spacecraft); // once for each state: a refused one is not asked for again
    sent = performance.now();
    ask({ do: "map", joints: map?.joints ?? null });
  }

  function note() {
    const held = map.spacecraft === "free-floating" ? "" : ` Spacecraft ${map.spacecraft}.`;
    return (map.curves
      ? "Lines: singular postures, exact. Colour: distance to first order, from vermilion at 0 to blue at 30°."
      : "Colour: distance to first order, vermilion at 0, blue from 30° on.") + held;
  }

  return {
    show(state) {
      if (!dragging) q = [...state.q];
      box = state.box;
      spacecraft = state.spacecraft;
      refresh();
    },
    draw(received) {
      map = received;
      took = performance.now() - sent;
      asked = held(map.q, map.spacecraft);
      picks.forEach((pick, k) => (pick.value = map.joints[k]));
      byId("mapnote").textContent = note();
      paintPicture();
      paint();
      canvas.dataset.held = asked;
    },
  };
}
