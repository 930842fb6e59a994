/* Playback of a motion: calls onTime(t, true) while time runs, onTime(t, false) where it was moved to
   or has stopped. Space plays and pauses. */

import { byId, digits, element, fixed } from "./format.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 100];

export function createPlayback(onTime) {
  const box = byId("motion");
  const [button, slider, output] = ["button", "input", "output"].map((s) => box.querySelector(s));
  const [speed, loop] = [byId("speed"), byId("loop")];
  SPEEDS.forEach((x) => speed.append(new Option(`${x}×`, x)));
  let [first, last, playing, before, now, once, ended] = [0, 0, false, 0, 0, false, () => {}];
  let loaded = "";

  /* Takes another motion, or none; a second look at the same one leaves time and speed alone. */
  function load(motion) {
    setPlaying(false);
    box.hidden = !motion;
    if (!motion) return;
    [first, last] = motion.span;
    Object.assign(slider, { min: first, max: last, step: "any" });
    byId("story").textContent = motion.compared
      ? `Solid: ${motion.story}. Dashed, and the blue ghost: ${motion.compared}.` : motion.story;
    byId("described").querySelector("div").replaceChildren(...described(motion.described));
    const key = JSON.stringify([motion.story, motion.events]);
    if (loaded !== key) {
      loaded = key;
      speed.value = SPEEDS.find((x) => x >= 1 && (last - first) / x <= 60) ?? SPEEDS.at(-1);
      now = first;
    }
    mark(motion.events);
    show(Math.min(Math.max(now, first), last));
  }

  /* Returns what there is to say of a motion: its notes and tables, texts and no markup. */
  function described({ notes, tables }) {
    const row = (tag, texts) => {
      const made = element("tr");
      made.append(...texts.map((text) => element(tag, text)));
      return made;
    };
    return [...notes.map((note) => element("p", note)), ...tables.flatMap(({ title, head, rows }) => {
      const table = element("table");
      table.append(row("th", head), ...rows.map((texts) => row("td", texts)));
      return [element("h3", title), table];
    })];
  }

  function mark(events) {
    const span = last - first;
    byId("events").replaceChildren(...events.map(({ t, kind, detail }) => {
      const made = element("button", "", "event");
      const words = `${kind} at ${digits(t)} s${detail ? `: ${detail}` : ""}`;
      Object.assign(made, { type: "button", title: words });
      made.setAttribute("aria-label", words);
      made.style.left = `${span > 0 ? (100 * (t - first)) / span : 0}%`;
      made.addEventListener("click", () => seek(t));
      return made;
    }));
  }

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
    document.body.classList.toggle("playing", on);
    button.textContent = on ? "Pause" : "Play";
    before = performance.now();
    if (on) requestAnimationFrame(tick);
  }

  function stop() {
    setPlaying(false);
    onTime(now, false);
  }

  function tick(moment) {
    if (!playing) return;
    const span = last - first;
    let t = now + ((moment - before) / 1000) * Number(speed.value);
    before = moment;
    if (t >= last && loop.checked && !once) t = span > 0 ? first + ((t - first) % span) : first;
    t = Math.min(Math.max(t, first), last);
    show(t);
    onTime(t, true);
    if (t >= last && (!loop.checked || once)) stop();
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
    if (playing) stop();
    else {
      if (now >= last) show(first);
      setPlaying(true);
    }
  }

  function seek(t) {
    setPlaying(false);
    show(t);
    slider.value = t;
    onTime(t, false);
  }

  button.addEventListener("click", toggle);
  slider.addEventListener("input", () => seek(Number(slider.value)));
  document.addEventListener("keydown", (event) => {
    const typing = event.target.closest?.("button, select, summary, input:not([type=range])");
    if (event.key !== " " || typing || box.hidden) return;
    event.preventDefault();
    toggle();
  });
  /* Times of frames at the chosen speed, the last one at the end of the motion. */
  function times(perSecond, most) {
    const number = Math.ceil(((last - first) * perSecond) / Number(speed.value)) + 1;
    const count = Math.min(Math.max(number, 1), most);
    return Array.from({ length: count }, (_, i) => first + ((last - first) * i) / Math.max(count - 1, 1));
  }

  return { load, times, show: (t) => playing || show(t), seek, playOnce, at: () => (playing ? now : null) };
}
