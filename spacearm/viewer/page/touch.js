/* Explanations where nothing hovers: a tap on a symbol shows its title, a long press that of a
   control, which a tap works. */

import { byId } from "./format.js";

const CONTROLS = "button, input, select, summary, canvas, svg";

export function explainByTouch() {
  const box = byId("explanation");
  let touch = false;
  const hide = () => (box.hidden = true);

  function show(node, { clientX, clientY }) {
    const words = node?.closest("[title]")?.title;
    if (!words) return false;
    box.textContent = words;
    box.hidden = false;
    const { width, height } = box.getBoundingClientRect();
    box.style.left = `${Math.max(4, Math.min(clientX - width / 2, window.innerWidth - width - 4))}px`;
    box.style.top = `${clientY > height + 20 ? clientY - height - 14 : clientY + 20}px`;
    return true;
  }

  document.addEventListener("pointerdown", ({ pointerType }) => {
    touch = pointerType === "touch";
    hide();
  }, { capture: true });
  document.addEventListener("scroll", hide, { capture: true, passive: true });
  document.addEventListener("click", (event) => {
    if (touch && !event.target.closest(CONTROLS)) show(event.target, event);
  });
  document.addEventListener("contextmenu", (event) => {
    if (touch && show(event.target, event)) event.preventDefault();
  });
}
