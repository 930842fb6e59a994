"""Milliseconds from moving a slider in the browser to the readout and to the map that follow.

    python benchmarks/view.py        # needs pip install -e '.[test]' and chromium

Headless chromium draws with the processor, beside the server on the same cores: a graphics card
takes most of that away. The slider moves 40 times; median and largest time, for two windows. Then a
joint moves that is not on the map of two joints, 20 times, until the new map is drawn; the scene is
not drawn meanwhile, which a graphics card would do. First the size of saved pages, without meshes
(chaser7) and with them.
"""

from __future__ import annotations

from shutil import which

import numpy as np
from playwright.sync_api import sync_playwright

import spacearm as sa

MEASURE = """async () => {
  const slider = document.querySelector(".joint input[type=range]");
  const tip = document.getElementById("tip");
  const times = [];
  for (let i = 0; i < 40; i++) {
    const before = tip.textContent;
    const start = performance.now();
    slider.value = Number(slider.value) + 1;
    slider.dispatchEvent(new Event("input"));
    while (tip.textContent === before) await new Promise((go) => setTimeout(go, 0));
    times.push(performance.now() - start);
  }
  return times;
}"""

MAP = """async () => {
  const canvas = document.getElementById("mapcanvas");
  const shown = [...document.querySelectorAll("#map select")].map(({ value }) => Number(value));
  const sliders = [...document.querySelectorAll(".joint input[type=range]")];
  const slider = sliders.findLast((_, i) => !shown.includes(i));
  const times = [];
  for (let i = 0; i < 20; i++) {
    const before = canvas.dataset.held;
    const start = performance.now();
    slider.value = Number(slider.value) + 1;
    slider.dispatchEvent(new Event("input"));
    while (canvas.dataset.held === before) await new Promise((go) => setTimeout(go, 0));
    times.push(performance.now() - start);
    await new Promise((go) => setTimeout(go, 200));
  }
  return times;
}"""


DRAWING = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
NO_DRAWING = ["--no-sandbox", "--disable-3d-apis"]
MAPPED = ("planar3", "mda6", "chaser7", "dual_ur5")


def main() -> None:
    for name in ("chaser7", "dual_ur5"):
        size = len(sa.view(sa.load(name), open=False).html().encode())
        print(f"saved page, {name}: {size / 1e6:.1f} MB")
    with sync_playwright() as playwright:
        for name, sizes, what, script, options in (
            ("chaser7", ((420, 320), (1366, 768)), "readout", MEASURE, DRAWING),
            *((name, ((1366, 768),), "map", MAP, NO_DRAWING) for name in MAPPED),
        ):
            browser = playwright.chromium.launch(executable_path=which("chromium"), args=options)
            viewer = sa.view(sa.load(name), open=False)
            for width, height in sizes:
                page = browser.new_page(viewport={"width": width, "height": height})
                page.goto(viewer.serve())
                page.wait_for_selector("body[data-ready=yes]", state="attached")
                page.wait_for_timeout(2000)
                times = np.array(page.evaluate(script))
                print(
                    f"{what}, {name}, {width} x {height}: median {np.median(times):.0f} ms, "
                    f"largest {times.max():.0f} ms"
                )
                page.close()
            viewer.close()
            browser.close()


if __name__ == "__main__":
    main()
