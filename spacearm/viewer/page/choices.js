/* Which arm is shown, and what of it counts: from the catalogue, from a file, from an address. */

import { byId } from "./format.js";

const LARGEST = 1_900_000; // bytes of a file as it is sent; the server takes no larger messages

export function createChoices({ model, tip, choices }, ask, complain, getState) {
  const [robot, link, task, counted] = ["robot", "tiplink", "task", "counted"].map(byId);
  if (!choices.robots.includes(model)) robot.append(new Option(model, ""));
  for (const name of choices.robots) robot.append(new Option(name, name));
  byId("file").accept = choices.suffixes.join();
  robot.value = choices.robots.includes(model) ? model : "";
  for (const name of choices.links) link.append(new Option(name, name));
  if (!choices.links.includes(tip)) link.append(new Option(tip, tip));
  link.value = tip;
  task.value = choices.task;
  for (const name of choices.joints) {
    const label = document.createElement("label");
    const box = Object.assign(document.createElement("input"), { type: "checkbox", value: name });
    box.checked = choices.counted.includes(name);
    label.append(box, ` ${name}`);
    counted.append(label);
  }

  const arm = { model, robot: choices.robot, tip, task: choices.task, joints: choices.counted,
    locked: choices.locked };

  robot.addEventListener("change", () => robot.value && ask({ do: "arm", robot: robot.value }));
  link.addEventListener("change", () => ask({ do: "arm", tip: link.value }));
  byId("apply").addEventListener("click", () => {
    const boxes = [...counted.querySelectorAll("input")];
    const message = { do: "arm", tip: link.value };
    if (task.value.trim() !== choices.task) message.task = task.value.trim();
    const names = boxes.filter(({ checked }) => checked).map(({ value }) => value);
    if (names.join("\n") !== choices.counted.join("\n")) message.joints = names;
    ask(message);
  });

  async function take(file) {
    if (!file) return;
    const text = file.size > LARGEST ? "" : await file.text();
    const size = Math.max(file.size, new Blob([JSON.stringify(text)]).size);
    if (size > LARGEST) {
      complain(`${file.name} takes ${size} bytes, the page sends up to ${LARGEST}: `
        + "open it with spacearm view");
      return;
    }
    complain("");
    ask({ do: "arm", file: { name: file.name, text } });
  }

  byId("file").addEventListener("change", ({ target }) => take(target.files[0]));
  const isFile = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");
  document.addEventListener("dragover", (event) => {
    if (!isFile(event)) return;
    event.preventDefault();
    document.body.classList.add("dropping");
  });
  document.addEventListener("dragleave", (event) => {
    if (!event.relatedTarget) document.body.classList.remove("dropping");
  });
  document.addEventListener("drop", (event) => {
    document.body.classList.remove("dropping");
    if (!isFile(event)) return;
    event.preventDefault();
    take(event.dataTransfer.files[0]);
  });

  byId("link").addEventListener("click", async () => {
    const { q, base, mode, spacecraft } = getState();
    const state = encodeURIComponent(JSON.stringify({ ...arm, q, base, mode, spacecraft }));
    try {
      await navigator.clipboard.writeText(`${location.href.split("#")[0]}#${state}`);
      byId("link").textContent = "Copied";
    } catch {
      complain("the browser does not allow copying");
    }
    setTimeout(() => (byId("link").textContent = "Copy link"), 1500);
  });

  /* Brings back what stands behind the # of the address, once: first the arm, which loads the page
     anew, then its posture. */
  function restore() {
    const told = location.hash.slice(1);
    if (!told) return;
    const address = location.href.split("#")[0];
    history.replaceState(null, "", address);
    try {
      const { q, base, mode, spacecraft, asked, ...wanted } = JSON.parse(decodeURIComponent(told));
      const isHere = Object.keys(arm).every((k) =>
        JSON.stringify(arm[k]) === JSON.stringify(wanted[k]));
      if (!isHere && (asked || (wanted.model !== model && !wanted.robot))) {
        complain(`the address is that of ${wanted.model}, this is ${model}: open that first`);
        return;
      }
      if (!isHere) {
        const again = { ...wanted, q, base, mode, spacecraft, asked: true };
        history.replaceState(null, "", `${address}#${encodeURIComponent(JSON.stringify(again))}`);
        const { tip, task, joints, locked } = wanted;
        const robot = wanted.model === model ? undefined : wanted.robot;
        ask({ do: "arm", robot, tip, task, joints, locked });
        return;
      }
      ask({ do: "spacecraft", mode: spacecraft });
      ask({ do: "mode", mode });
      ask({ do: "posture", q, base });
    } catch {
      complain("the part of the address behind # is not understood");
    }
  }
  return { restore };
}
