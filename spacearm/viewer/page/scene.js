/* The drawing, the same on the live page and in saved ones: theme, size, layers' legend. */

const BACKGROUND = {
  light: { top_color: [0.97, 0.98, 0.99], bottom_color: [0.84, 0.87, 0.91] },
  dark: { top_color: [0.15, 0.17, 0.2], bottom_color: [0.06, 0.07, 0.09] },
};

export function createViewer(element) {
  const viewer = new MeshCat.Viewer(element);
  viewer.gui.domElement.style.display = "none"; // meshcat's own controls; the panel has ours
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const paint = () => {
    for (const [name, rgb] of Object.entries(BACKGROUND[dark.matches ? "dark" : "light"])) {
      viewer.set_property(["Background"], name, rgb);
    }
  };
  paint();
  dark.addEventListener("change", paint);
  new ResizeObserver(() => {
    viewer.set_3d_pane_size(element.clientWidth, element.clientHeight);
  }).observe(element);
  return viewer;
}

export function legend(list, layers, onChange) {
  for (const [name, color] of Object.entries(layers)) {
    const label = document.createElement("label");
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = true;
    box.dataset.layer = name;
    box.addEventListener("change", () => onChange(name, box.checked));
    const swatch = document.createElement("span");
    swatch.className = "swatch";
    swatch.style.background = color;
    label.append(box, swatch, name);
    list.append(label);
  }
}

/* Play button and time slider: calls onTime(t) while time runs or is dragged. */
export function timeControls(element, [first, last], onTime) {
  element.hidden = false;
  const button = element.querySelector("button");
  const slider = element.querySelector("input");
  const output = element.querySelector("output");
  Object.assign(slider, { min: first, max: last, step: (last - first) / 1000 || 1, value: first });
  let playing = false;
  let before = 0;
  const show = (t) => {
    slider.value = t;
    output.textContent = `${Number(t).toFixed(2)} s`;
  };
  const setPlaying = (on) => {
    playing = on;
    button.textContent = on ? "Pause" : "Play";
    before = performance.now();
    if (on) requestAnimationFrame(tick);
  };
  const tick = (now) => {
    if (!playing) return;
    const t = Math.min(Number(slider.value) + (now - before) / 1000, last);
    before = now;
    show(t);
    onTime(t);
    if (t >= last) setPlaying(false);
    else requestAnimationFrame(tick);
  };
  button.addEventListener("click", () => {
    if (!playing && Number(slider.value) >= last) show(first);
    setPlaying(!playing);
  });
  slider.addEventListener("input", () => {
    setPlaying(false);
    show(slider.value);
    onTime(Number(slider.value));
  });
  slider.step = "any";
  show(first);
  return show;
}
