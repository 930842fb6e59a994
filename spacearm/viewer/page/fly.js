/* The tip led by keyboard and gamepad: twists to the server's servo, as long as one flies. */

import { byId, fixed } from "./format.js";

const KEYS = { w: [0, 1], s: [0, -1], a: [1, 1], d: [1, -1], r: [2, 1], f: [2, -1],
  u: [3, 1], o: [3, -1], i: [4, 1], k: [4, -1], j: [5, 1], l: [5, -1] };
const NAMES = ["x", "y", "z", "turn x", "turn y", "turn z"];
const EVERY = 40; // ms between two messages
const LONGEST = 0.1; // s that one message flies
const DEAD = 0.12; // of a stick that rests
const PULLED = "The gamepad is disconnected: the tip comes to rest. Hold a key, or move a stick.";

export function createFly(ask, begins) {
  const button = byId("fly");
  const held = new Set();
  let [flying, under, last, timer, moving, pulled] = [false, false, 0, 0, false, false];

  function twist() {
    const wish = [0, 0, 0, 0, 0, 0];
    for (const key of held) wish[KEYS[key][0]] += KEYS[key][1];
    for (const pad of navigator.getGamepads?.() ?? []) {
      if (!pad || pad.connected === false) continue;
      const [left, up, , lift] = [0, 1, 2, 3].map((i) =>
        Math.abs(pad.axes[i] ?? 0) > DEAD ? -pad.axes[i] : 0);
      const turn = pad.buttons[4]?.pressed || pad.buttons[5]?.pressed ? 3 : 0;
      for (const [i, value] of [up, left, lift].entries()) wish[turn + i] += value;
    }
    const speed = byId("flyspeed").valueAsNumber || 0;
    return wish.map((x) => Math.max(-1, Math.min(1, x)) * speed);
  }

  function send() {
    const now = performance.now();
    const wish = twist();
    if (under || (!moving && !wish.some(Boolean))) {
      if (!under) last = now;
      return;
    }
    const dt = Math.min((now - last) / 1000, LONGEST);
    [under, last] = [true, now];
    ask({ do: "fly", twist: wish, dt, frame: byId("flyframe").value });
  }

  function turn(on) {
    if (on === flying) return;
    flying = on;
    button.setAttribute("aria-pressed", String(on));
    button.textContent = on ? "End" : "Fly";
    clearInterval(timer);
    held.clear();
    [under, moving, pulled, last] = [false, false, false, performance.now()];
    if (on) timer = setInterval(send, EVERY);
    else ask({ do: "land" });
    byId("flown").textContent = on ? "Hold a key, or move a stick." : "";
  }

  button.addEventListener("click", () => turn(!flying));
  window.addEventListener("keydown", (event) => {
    const key = event.key.toLowerCase();
    if (!flying || !(key in KEYS) || event.ctrlKey || event.metaKey || event.altKey) return;
    if (["INPUT", "SELECT"].includes(event.target.tagName) && event.target.type !== "range") return;
    held.add(key);
    event.preventDefault();
  });
  window.addEventListener("keyup", (event) => held.delete(event.key.toLowerCase()));
  window.addEventListener("blur", () => held.clear());
  window.addEventListener("gamepaddisconnected", () => {
    pulled = flying;
    if (pulled) byId("flown").textContent = PULLED;
  });
  if (begins) turn(true);

  return ({ flight }) => {
    under = false;
    if (!flying || !flight) return;
    moving = flight.moving;
    if (pulled &&= !twist().some(Boolean)) return;
    const lost = flight.lost.map((x, i) => [x, NAMES[i]]).filter(([x]) => Math.abs(x) > 0.3)
      .map(([x, name]) => `${name} ${fixed(x, 1)}`).join(", ");
    byId("flown").textContent = flight.slowed
      ? `Slowed by ${flight.slowed}: ${Math.round(100 * flight.done)} % of the wish is done. `
        + `The direction that is being lost: ${lost}` : "Free.";
  };
}
