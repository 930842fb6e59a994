/* Curves of a motion in step with the drawing; a click in them goes to that time. */

import { byId } from "./format.js";

const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8a6d00", "#56b4e9", "#777777"];

export function createChart(seek) {
  const box = byId("chart");
  const choice = byId("curves");
  let [plot, motion, now] = [null, null, 0];

  const height = () => Math.max(110, Math.min(180, 0.2 * window.innerHeight));
  const line = () => {
    if (plot) plot.setCursor({ left: plot.valToPos(now, "x"), top: 10 }, false);
  };

  function load(told) {
    motion = told;
    const before = choice.selectedOptions[0]?.textContent;
    choice.replaceChildren();
    motion?.curves.forEach(({ name, unit }, i) => choice.append(new Option(`${name} [${unit}]`, i)));
    const same = [...choice.options].find((option) => option.textContent === before);
    choice.value = same?.value
      ?? Math.max(motion?.curves.findIndex(({ name }) => name === "distance") ?? 0, 0);
    draw();
  }

  /* Each with its colour; of more curves than colours, and of another motion, dashed. */
  const series = (labels, dash) => labels.map((label, i) => ({
    label, stroke: COLOURS[i % COLOURS.length], width: 2,
    dash: dash ?? (i >= COLOURS.length ? [2, 3] : undefined), points: { show: motion.t.length < 3 },
    value: (_, x) => (x === null ? "–" : String(Number(x.toPrecision(4)))),
  }));

  function draw() {
    plot?.destroy();
    plot = null;
    if (!motion) return;
    const { unit, labels, values, beside } = motion.curves[choice.value];
    const ink = getComputedStyle(document.body).color;
    const axis = { stroke: ink, grid: { stroke: "#8888", width: 0.5 }, ticks: { stroke: "#8888" } };
    const names = (beside?.labels ?? []).map((label) => `${label}, ${motion.compared}`);
    plot = new uPlot({
      width: Math.max(box.clientWidth, 100),
      height: height(),
      legend: { live: true },
      cursor: { drag: { x: false, y: false }, y: false },
      scales: { x: { time: false } },
      axes: [{ ...axis, label: "t [s]", labelSize: 18, size: 34 },
        { ...axis, label: `[${unit}]`, labelSize: 18, size: 54, space: 22 }],
      series: [{ label: "t" }, ...series(labels), ...series(names, [7, 5])],
    }, [motion.t, ...values, ...(beside?.values ?? [])], box);
    plot.over.addEventListener("click", () => seek(plot.posToVal(plot.cursor.left, "x")));
    line();
  }

  choice.addEventListener("change", draw);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  new ResizeObserver(() => {
    if (plot && box.clientWidth) plot.setSize({ width: box.clientWidth, height: height() });
    line();
  }).observe(box);
  return {
    load,
    show(time) {
      now = time;
      line();
    },
  };
}
