/* The joints' sliders and boxes. What cannot be is refused beside the box, in its unit. */

import { DEGREE, byId, element, fixed } from "./format.js";

const THUMB = 8; // px from the end of a slider to the middle of its thumb there

export function refuse(row, text) {
  let words = row.querySelector(".refusal");
  if (!words) {
    words = element("p", "", "refusal");
    words.setAttribute("role", "alert");
    row.append(words);
  }
  words.textContent = text;
}

export function createJoints(joints, onMove) {
  const controls = joints.map((joint, index) => control(joint, index, onMove));
  return {
    show(q, isWaiting) {
      q.forEach((value, i) => {
        const { slider, number, say } = controls[i];
        if (document.activeElement === slider && isWaiting(i)) return;
        controls[i].value = value;
        if (document.activeElement !== slider) slider.value = say(value);
        if (document.activeElement !== number) number.value = say(value);
        slider.setAttribute("aria-valuetext", `${say(value)} ${controls[i].words}`);
      });
    },
    /* Marks the ranges in which no posture is singular; null takes the marks away. */
    mark(box) {
      controls.forEach(({ mark }, i) => mark(box?.ranges[i]));
      byId("ranges").textContent = box ? "Green: no posture with all joints in these ranges is "
        + `singular, proven. This posture is ${box.holds ? "in them" : "outside"}.` : "";
    },
  };
}

function control({ name, label, angle, lower, upper }, index, onMove) {
  const factor = angle ? DEGREE : 1;
  const [sign, words, places] = angle ? ["°", "degrees", 2] : [" m", "metres", 3];
  const say = (value) => fixed(value / factor, places);
  const range = `${Number(say(lower))}${sign} to ${Number(say(upper))}${sign}`;
  const row = element("div", "", "joint");
  const title = element("span", label, "name");
  row.title = title.title = `${name}, ${range}`;
  const [slider, number] = ["range", "number"].map((type) => {
    const input = document.createElement("input");
    const step = type === "range" ? "any" : angle ? 1 : 0.01;
    Object.assign(input, { type, min: lower / factor, max: upper / factor, step });
    input.setAttribute("aria-label", `${name} in ${words}`);
    return input;
  });
  slider.step = (upper - lower) / factor / 3600; // arrow keys move by a tenth of a degree of 360
  const [rail, strip] = [element("div", "", "rail"), element("div", "", "free")];
  strip.hidden = true;
  const place = (x) => `calc(${THUMB}px + ${(x - lower) / (upper - lower)} * (100% - ${2 * THUMB}px))`;
  const mark = (free) => {
    row.title = `${name}, ${range}`;
    strip.hidden = !free;
    if (!free) return;
    const [from, to] = free.map(place);
    Object.assign(strip.style, { left: from, width: `calc(${to} - ${from})` });
    row.title += `; no singular posture from ${free.map((x) => say(x) + sign).join(" to ")}, proven`;
  };
  const made = { slider, number, say, words, mark, value: 0 };
  slider.addEventListener("input", () => {
    refuse(row, "");
    onMove(index, slider.value * factor);
  });
  number.addEventListener("change", () => {
    const value = number.valueAsNumber * factor;
    const slack = 1e-6 * (upper - lower);
    if (value >= lower - slack && value <= upper + slack) {
      refuse(row, "");
      onMove(index, value);
      return;
    }
    refuse(row, number.value === "" ? `give a number, ${range}`
      : `${number.value}${sign} is outside its range, ${range}`);
    number.value = say(made.value);
  });
  rail.append(slider, strip);
  row.append(title, rail, number, element("span", sign.trim(), "unit"));
  byId("joints").append(row);
  return made;
}
