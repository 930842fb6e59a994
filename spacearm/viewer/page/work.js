/* What the server computes meanwhile, with progress and cancel: plans to a goal of the tip,
   workspaces, risk, feasible attitudes, free joint ranges. */

import { DEGREE, byId, fixed } from "./format.js";
import { pointUnder, toDrawing, toInertial } from "./scene.js";

const SLOW = 1000; // ms after which the page says what it waits for
const SLOW_ONES = {
  arm: "Loading the arm",
  map: "Computing the map",
  nearest: "Searching the nearest singular posture",
  poses: "Computing the frames of the motion",
};

/* Says what the page waits for, where an answer takes long; null ends it. */
export function createWaiting() {
  let timer = 0;
  return (message) => {
    clearTimeout(timer);
    byId("waiting").hidden = true;
    if (!message) return;
    timer = setTimeout(() => {
      byId("waiting").textContent = `${SLOW_ONES[message.do] ?? "Waiting for Python"} …`;
      byId("waiting").hidden = false;
    }, SLOW);
  };
}

export function createWork(viewer, { task, normal }, ask) {
  const box = byId("work");
  const bar = box.querySelector("progress");
  byId("cancel").addEventListener("click", () => ask({ do: "cancel" }));
  const buttons = [...document.querySelectorAll("[data-compute]")];
  let [asked, busy] = [false, false];
  for (const button of buttons) {
    button.addEventListener("click", () => {
      asked = button.dataset.compute !== "ranges";
      ask({ do: "compute", what: button.dataset.compute, path: path.value });
    });
  }
  const path = byId("attitudepath");
  const goal = createGoal(viewer, { task, normal }, ask);

  return (state) => {
    const [name, words, done, total] = state.task ?? [];
    box.hidden = !name;
    if (name) {
      bar.max = total || 1;
      if (total) bar.value = done;
      else bar.removeAttribute("value");
      box.querySelector("span").textContent = total
        ? name === "plan" ? `${words}: ${fixed(done, 0)} s of at most ${fixed(total, 0)} s`
          : `${words}: ${Math.round((100 * done) / total)} %`
        : `${words} …`;
    }
    const [failed, why] = state.failure ?? [];
    byId("planfailure").textContent = failed === "plan" ? why : "";
    byId("rangesfailure").textContent = failed === "ranges" ? why : "";
    byId("layerfailure").textContent = failed && !["plan", "ranges"].includes(failed) ? why : "";
    for (const button of buttons) button.disabled = Boolean(name);
    const known = { goal: Boolean(state.goal), motion: state.motion };
    for (const option of path.options) option.disabled = !known[option.value];
    if (!known[path.value]) path.value = known.goal ? "goal" : "motion";
    if (!known[path.value]) document.querySelector("[data-compute=attitudes]").disabled = true;
    goal(state, Boolean(name));
    if (busy && !name && asked) {
      byId("legend").scrollIntoView({ block: "nearest" }); // what the new colours mean
      asked = false;
    }
    busy = Boolean(name);
  };
}

/* The boxes of the goal: a position and angles, as far as the task has them. */
function createGoal(viewer, { task, normal }, ask) {
  const [place, angles] = ["goalplace", "goalangles"].map((id) =>
    [...byId(id).querySelectorAll("input")]);
  const flat = normal && normal.findIndex(Boolean);
  const turns = task.some((row) => row.startsWith("r"));
  const shown = { goalplace: task.some((row) => !row.startsWith("r")), goalangles: turns };
  for (const [id, on] of Object.entries(shown)) byId(id).hidden = !on;
  if (normal) {
    place[flat].closest("label").hidden = true;
    angles.forEach((input, i) => (input.closest("label").hidden = i !== flat));
  }
  let [state, picking] = [null, false];

  const present = () => state.goal ?? { position: state.tip, rpy: undefined };
  const set = (part) => ask({ do: "goal", ...present(), ...part });

  place.forEach((input, i) => input.addEventListener("change", () => {
    if (input.value === "") return;
    set({ position: present().position.map((x, k) => (k === i ? Number(input.value) : x)) });
  }));
  angles.forEach((input, i) => input.addEventListener("change", () => {
    if (input.value === "") return;
    const rpy = present().rpy ?? state.tip_rpy;
    set({ rpy: rpy.map((x, k) => (k === i ? Number(input.value) * DEGREE : x)) });
  }));
  byId("goalhere").addEventListener("click", () => ask({ do: "goal" }));
  byId("plan").addEventListener("click", () => ask({ do: "plan" }));

  function pick(on) {
    picking = on;
    document.body.classList.toggle("picking", on);
    byId("goalpick").setAttribute("aria-pressed", String(on));
  }
  byId("goalpick").disabled = !viewer;
  byId("goalpick").addEventListener("click", () => pick(!picking));
  document.addEventListener("keydown", ({ key }) => key === "Escape" && pick(false));
  byId("scene").addEventListener("pointerdown", (event) => {
    if (!picking) return;
    event.preventDefault();
    event.stopPropagation(); // the camera stays
    const { Plane, Vector3 } = MeshCat.THREE;
    const facing = normal ? toDrawing(normal) : viewer.camera.getWorldDirection(new Vector3());
    const through = toDrawing(present().position);
    const plane = new Plane().setFromNormalAndCoplanarPoint(facing, through);
    const point = pointUnder(viewer, event, plane);
    if (point) set({ position: toInertial(point) });
    pick(false);
  }, { capture: true });

  return (told, busy) => {
    state = told;
    byId("plan").disabled = busy || !state.goal;
    const shownGoal = state.goal;
    const fill = (input, value, present) => {
      if (document.activeElement === input) return;
      if (input.value !== value) input.value = value;
      if (input.placeholder !== present) input.placeholder = present;
    };
    place.forEach((input, i) =>
      fill(input, shownGoal ? fixed(shownGoal.position[i], 3) : "", fixed(state.tip[i], 3)));
    angles.forEach((input, i) => fill(input, shownGoal ? fixed(shownGoal.rpy[i] / DEGREE, 1) : "",
      fixed(state.tip_rpy[i] / DEGREE, 1)));
  };
}
