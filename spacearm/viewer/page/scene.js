/* The drawing, the same on the live page and in saved ones: theme, size, legend of the layers. */

import { element } from "./format.js";

const BACKGROUND = {
  light: { top_color: [0.97, 0.98, 0.99], bottom_color: [0.84, 0.87, 0.91] },
  dark: { top_color: [0.15, 0.17, 0.2], bottom_color: [0.06, 0.07, 0.09] },
};

const MEANING = {
  "grid": "Squares in the inertial frame, below the robot or in the plane of a planar arm, with the coordinates of their lines.",
  "bodies": "The spacecraft and the links of the arm.",
  "centre of mass": "The centre of mass of the whole system, which stays at rest while it floats.",
  "virtual manipulator": "An arm on the fixed centre of mass that moves the tip as the floating one does.",
  "tip frame": "The axes of the tip: x red, y green, z blue.",
  "ellipsoid": "How far the tip goes within 0.3 s in each direction, with joint rates of 1 rad/s together.",
  "directions": "Magenta arrow and ring: motion and turn that the tip has lost; pink: the one that is nearly lost; amber line or disc: what is left.",
  "shells": "Workspaces about the centre of mass, cut open: vermilion where a path may meet a singular posture, blue where none does.",
  "risk": "How many of the postures that put the tip at this distance from the centre of mass are near a singular one.",
  "attitudes": "Where an axis of the spacecraft may point so that the tip can follow the path: blue where it can, vermilion where not.",
  "obstacles": "What must not be met.",
  "target": "What is caught, which tumbles until contact, the axes of its grapple frames, and those of the stand-off.",
  "wheels": "What each reaction wheel holds by spinning, as an arrow along its axis.",
  "wrenches": "Forces on the links as arrows, torques as arrows with two heads.",
  "trace": "The path of the tip, vermilion where a singular posture is near, blue from 30° on.",
  "goal": "Where the motion ends.",
  "comparison": "The motion that plays in step with this one.",
};

/* Returns null, and says so in the page, where the browser cannot draw in three dimensions. */
export function createViewer(node) {
  let viewer;
  try {
    viewer = new MeshCat.Viewer(node);
  } catch {
    node.replaceChildren(element(
      "p",
      "This browser does not draw in 3-D: WebGL is off or missing. The panel works without it. To "
        + "see the arm, allow hardware acceleration in the browser's settings, or open the page in "
        + "another browser.",
      "notice",
    ));
    return null;
  }
  viewer.gui.domElement.style.display = "none"; // meshcat's own controls; the page has ours
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const paint = () => {
    for (const [name, rgb] of Object.entries(BACKGROUND[dark.matches ? "dark" : "light"])) {
      viewer.set_property(["Background"], name, rgb);
    }
  };
  paint();
  dark.addEventListener("change", paint);
  const resize = viewer.set_3d_pane_size.bind(viewer);
  viewer.set_3d_pane_size = () => resize(node.clientWidth || 1, node.clientHeight || 1);
  new ResizeObserver(() => viewer.set_3d_pane_size()).observe(node);
  return viewer;
}

export function legend(list, layers, hidden, onChange) {
  for (const [name, colour] of Object.entries(layers)) {
    const label = document.createElement("label");
    label.title = MEANING[name] ?? "";
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = !hidden.includes(name);
    box.dataset.layer = name;
    box.addEventListener("change", () => onChange(name, box.checked));
    const swatch = element("span", "", "swatch");
    swatch.style.background = colour;
    label.append(box, swatch, name);
    list.append(label);
  }
}

/* Where the line of sight through a pointer meets a plane; null where it does not. */
export function pointUnder(viewer, { clientX, clientY }, plane) {
  const { Raycaster, Vector2, Vector3 } = MeshCat.THREE;
  const { left, top, width, height } = viewer.renderer.domElement.getBoundingClientRect();
  const at = new Vector2((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height);
  const ray = new Raycaster();
  ray.setFromCamera(at, viewer.camera);
  return ray.ray.intersectPlane(plane, new Vector3());
}

/* three.js has y upwards, meshcat turns it. */
export const toDrawing = ([x, y, z]) => new MeshCat.THREE.Vector3(x, z, -y);
export const toInertial = ({ x, y, z }) => [x, -z, y];
