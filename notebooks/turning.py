"""A surface of triangles that the mouse turns: a page of its own, without a library or network."""

from __future__ import annotations

import html
import json

import numpy as np

from spacearm.arrays import Array

PAGE = """<!doctype html><style>body { margin: 0; font: 13px sans-serif; overflow: hidden }
canvas { display: block; width: 100%; height: 100vh; touch-action: none; cursor: grab }</style>
<canvas></canvas><script>
const { corners, colours, labels } = DATA;
const canvas = document.querySelector("canvas"), pen = canvas.getContext("2d");
let turn = -1.0, tilt = 0.4, still = matchMedia("(prefers-reduced-motion: reduce)").matches;
function draw() {
  const dots = devicePixelRatio, w = canvas.clientWidth, h = canvas.clientHeight;
  canvas.width = w * dots; canvas.height = h * dots;
  pen.scale(dots, dots); pen.translate(w / 2, h / 2);
  const [c, s, ct, st] = [Math.cos(turn), Math.sin(turn), Math.cos(tilt), Math.sin(tilt)];
  const size = 0.28 * Math.min(w, h) / 180;
  const place = (x, y, z) => {
    const away = s * x + c * y;
    return [size * (c * x - s * y), size * (st * -away - ct * z), ct * away - st * z];
  };
  const sides = corners.map(([a, b, d], i) => {
    const p = [place(...a), place(...b), place(...d)];
    return { p, away: p[0][2] + p[1][2] + p[2][2], colour: colours[i] };
  }).sort((one, other) => other.away - one.away);
  box(place, true);
  for (const { p, colour } of sides) {
    pen.fillStyle = pen.strokeStyle = colour;
    pen.lineWidth = 0.4; pen.beginPath(); pen.moveTo(p[0][0], p[0][1]);
    pen.lineTo(p[1][0], p[1][1]); pen.lineTo(p[2][0], p[2][1]); pen.closePath();
    pen.fill(); pen.stroke();
  }
  box(place, false);
}
function box(place, behind) {
  pen.lineWidth = 1; pen.strokeStyle = behind ? "#888" : "#8884"; pen.fillStyle = "#777";
  for (let axis = 0; axis < 3; axis++) {
    for (const [u, v] of [[-180, -180], [-180, 180], [180, -180], [180, 180]]) {
      const at = (x) => { const q = [u, v]; q.splice(axis, 0, x); return place(...q); };
      const [a, b] = [at(-180), at(180)];
      pen.beginPath(); pen.moveTo(a[0], a[1]); pen.lineTo(b[0], b[1]); pen.stroke();
      if (!behind && u < 0 && v < 0) {
        for (const x of [-180, 180]) {
          const [tx, ty] = at(1.12 * x);
          pen.textAlign = "center"; pen.fillText(x + "\\u00b0", tx, ty);
        }
        const [tx, ty] = at(0); pen.fillText(labels[axis], tx, ty + 16);
      }
    }
  }
}
let held = null;
canvas.onpointerdown = (e) => { held = e; still = true; canvas.setPointerCapture(e.pointerId); };
canvas.onpointerup = () => { held = null; };
canvas.onpointermove = (e) => {
  if (!held) return;
  turn += 0.01 * (e.clientX - held.clientX);
  tilt = Math.max(-1.57, Math.min(1.57, tilt + 0.01 * (e.clientY - held.clientY)));
  held = e; draw();
};
onresize = draw;
(function step() { if (!still) { turn += 0.004; draw(); requestAnimationFrame(step); } })();
draw();
</script>"""


class Turning:
    """A drawing that turns by itself until it is dragged.

    Args:
        corners: (t, 3, 3) corners of triangles within -180 to 180 along each axis.
        colours: (t, 3) red, green and blue, from 0 to 1, in full light.
        labels: Names of the three axes.
    """

    def __init__(self, corners: Array, colours: Array, labels: list[str]) -> None:
        sides = np.diff(corners, axis=1)
        normals = np.cross(sides[:, 0], sides[:, 1])
        length = np.maximum(np.linalg.norm(normals, axis=1), 1e-9)
        sun = np.abs(normals @ [0.64, -0.48, 0.6]) / length  # alike from both sides
        levels = np.rint(255.0 * (0.35 + 0.65 * sun)[:, None] * colours).astype(int)
        self.shown = {
            "corners": np.rint(corners).astype(int).tolist(),
            "colours": [f"rgb({r},{g},{b})" for r, g, b in levels.tolist()],
            "labels": labels,
        }

    def html(self) -> str:
        """Return the page."""
        return PAGE.replace("DATA", json.dumps(self.shown, separators=(",", ":")))

    def _repr_html_(self) -> str:
        style = "width: 100%; height: 480px; border: 0"
        return f'<iframe srcdoc="{html.escape(self.html())}" style="{style}"></iframe>'
