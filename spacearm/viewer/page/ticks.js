/* Coordinates of the grid's lines, in metres: each stands where its line leaves the drawing, or
   ends, towards the viewer. */

import { byId, digits } from "./format.js";
import { toDrawing } from "./scene.js";

const EDGES = { left: 6, right: 6, top: 52, bottom: 8 }; // px around the drawing that stay free
const ROOM = { width: 58, height: 17 }; // px that a number takes
const LEVEL = 8; // px of difference up to which both ends are as near

/* `grid`: its step, the normal axis of its plane, its height along that, and its half width. */
export function createTicks({ camera }, { step, normal, height, half }) {
  const svg = byId("ticks");
  const axes = [0, 1, 2].filter((axis) => axis !== normal);
  const count = Math.round(half / step);

  function line(axis, value) {
    return [-half, half].map((end) => {
      const point = [0, 0, 0];
      point[normal] = height;
      point[axis] = value;
      point[axes[1 - axes.indexOf(axis)]] = end;
      return toDrawing(point).applyMatrix4(camera.matrixWorldInverse);
    });
  }

  /* The ends [x, y] of what is seen of a line, in px; null where nothing is. */
  function seen(axis, value, width, high) {
    let [a, b] = line(axis, value);
    if (a.z > b.z) [a, b] = [b, a]; // b is nearer: the camera looks along -z
    if (a.z > -camera.near) return null;
    if (b.z > -camera.near) b.lerp(a, (b.z + camera.near) / (b.z - a.z));
    const [from, to] = [a, b].map((p) => {
      const { x, y } = p.applyMatrix4(camera.projectionMatrix);
      return [((1 + x) / 2) * width, ((1 - y) / 2) * high];
    });
    const low = [EDGES.left, EDGES.top];
    const top = [width - EDGES.right, high - EDGES.bottom];
    let [first, last] = [0, 1];
    for (const k of [0, 1]) {
      const way = to[k] - from[k];
      if (way === 0 && (from[k] < low[k] || from[k] > top[k])) return null;
      const cuts = [low[k], top[k]].map((edge) => (edge - from[k]) / way).sort((x, y) => x - y);
      if (way !== 0) [first, last] = [Math.max(first, cuts[0]), Math.min(last, cuts[1])];
    }
    if (first >= last) return null;
    return [first, last].map((s) => from.map((x, k) => x + s * (to[k] - x)));
  }

  function nearest([one, two]) {
    if (Math.abs(one[1] - two[1]) <= LEVEL) return one[0] < two[0] ? one : two;
    return one[1] > two[1] ? one : two;
  }

  return () => {
    const { clientWidth: width, clientHeight: high } = svg.parentElement;
    const rulers = byId("rulers");
    const taken = [[rulers.offsetLeft + rulers.offsetWidth / 2, rulers.offsetTop
      + rulers.offsetHeight / 2, rulers.offsetWidth, rulers.offsetHeight]];
    const marks = axes.flatMap((axis) => Array.from({ length: 2 * count + 1 }, (_, i) => {
      const value = (i - count) * step;
      const ends = seen(axis, value, width, high);
      return ends && { at: nearest(ends), words: `${"xyz"[axis]} ${digits(value)} m` };
    })).filter(Boolean).sort((one, two) => two.at[1] - one.at[1]);
    svg.replaceChildren();
    for (const { at, words } of marks) {
      const x = Math.min(Math.max(at[0], ROOM.width / 2), width - ROOM.width / 2);
      const y = at[1] - ROOM.height / 2;
      const free = taken.every(([u, v, w, h]) =>
        Math.abs(x - u) > (ROOM.width + w) / 2 || Math.abs(y - v) > (ROOM.height + h) / 2);
      if (!free) continue;
      taken.push([x, y, ROOM.width, ROOM.height]);
      const text = document.createElementNS(svg.namespaceURI, "text");
      text.textContent = words;
      text.setAttribute("x", x);
      text.setAttribute("y", y + 4);
      svg.append(text);
    }
  };
}
