/* Numbers as people read them: no noise of rounding, no minus before a zero. */

export const DEGREE = Math.PI / 180;

export function fixed(x, places) {
  const text = x.toFixed(places);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

/* n digits; what is not above `noise` is zero. */
export function digits(x, n = 4, noise = 1e-12) {
  if (x === null) return "∞";
  if (Math.abs(x) <= noise) return "0";
  const plain = Math.abs(x) >= 1e-3 && Math.abs(x) < 1e6;
  return plain ? Number(x.toPrecision(n)).toString() : x.toExponential(2);
}

/* Vermilion at 0, yellow, blue from 1 on: as the paths in the drawing. */
const SCALE = [[213, 94, 0], [240, 228, 66], [0, 114, 178]];

export function distanceColour(share) {
  const x = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1);
  const i = Math.min(Math.floor(x), SCALE.length - 2);
  return SCALE[i].map((from, k) => Math.round(from + (x - i) * (SCALE[i + 1][k] - from)));
}

export function element(tag, text = "", className = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  if (className) made.className = className;
  return made;
}

export const byId = (id) => document.getElementById(id);
