/* Playback of a motion: calls onTime(t) while time runs or is moved. Space plays and pauses. */

import { byId, digits, element, fixed } from "./format.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 100];

export function createPlayback({ span: [first, last], events, story }, onTime) {
  const box = byId("motion");
  box.hidden = false;
  const [button, slider, output] = ["button", "input", "output"].map((s) => box.querySelector(s));
  const speed = byId("speed");
  const loop = byId("loop");
  Object.assign(slider, { min: first, max: last, step: "any", value: first });
  byId("story").textContent = story;
  SPEEDS.forEach((x) => speed.append(new Option(`${x}×`, x)));
  const span = last - first;
  speed.value = SPEEDS.find((x) => span / x <= 60) ?? SPEEDS.at(-1);
  if (speed.value < 1) speed.value = 1;
  let [playing, before, now, ended] = [false, 0, first, () => {}];

  let once = false;

  function show(t) {
    now = t;
    if (document.activeElement !== slider || playing) slider.value = t;
    output.textContent = `${fixed(t, 2)} s`;
    slider.setAttribute("aria-valuetext", `${fixed(t, 2)} seconds of ${fixed(last, 2)}`);
  }

  function setPlaying(on) {
    playing = on;
    if (!on) {
      ended();
      ended = () => {};
    }
    button.textContent = on ? "Pause" : "Play";
    before = performance.now();
    if (on) requestAnimationFrame(tick);
  }

  function tick(moment) {
    if (!playing) return;
    let t = now + ((moment - before) / 1000) * Number(speed.value);
    before = moment;
    if (t >= last && loop.checked && !once) t = span > 0 ? first + ((t - first) % span) : first;
    t = Math.min(Math.max(t, first), last);
    show(t);
    onTime(t);
    if (t >= last && (!loop.checked || once)) setPlaying(false);
    else requestAnimationFrame(tick);
  }

  function playOnce(done) {
    show(first);
    once = true;
    ended = () => {
      once = false;
      done();
    };
    setPlaying(true);
  }

  function toggle() {
    if (!playing && now >= last) show(first);
    setPlaying(!playing);
  }

  function seek(t) {
    setPlaying(false);
    show(t);
    slider.value = t;
    onTime(t);
  }

  button.addEventListener("click", toggle);
  slider.addEventListener("input", () => seek(Number(slider.value)));
  document.addEventListener("keydown", (event) => {
    const typing = event.target.closest?.("button, select, summary, input:not([type=range])");
    if (event.key !== " " || typing) return;
    event.preventDefault();
    toggle();
  });
  for (const { t, kind, detail } of events) {
    const mark = element("button", "", "event");
    const words = `${kind} at ${digits(t)} s${detail ? `: ${detail}` : ""}`;
    Object.assign(mark, { type: "button", title: words });
    mark.setAttribute("aria-label", words);
    mark.style.left = `${span > 0 ? (100 * (t - first)) / span : 0}%`;
    mark.addEventListener("click", () => seek(t));
    byId("events").append(mark);
  }
  show(first);
  return { show: (t) => playing || show(t), seek, playOnce };
}
