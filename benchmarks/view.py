"""Milliseconds from moving a slider in the browser to the readout that follows.

    python benchmarks/view.py        # needs pip install -e '.[test]' and chromium

Headless chromium draws with the processor, beside the server on the same cores: a graphics card
takes most of that away. The slider moves 40 times; median and largest time, for two windows.
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


def main() -> None:
    options = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    viewer = sa.view(sa.load("chaser7"), open=False)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=which("chromium"), args=options)
        for width, height in ((420, 320), (1366, 768)):
            page = browser.new_page(viewport={"width": width, "height": height})
            page.goto(viewer.serve())
            page.wait_for_selector("body[data-ready=yes]", state="attached")
            page.wait_for_timeout(1000)
            times = np.array(page.evaluate(MEASURE))
            print(
                f"chaser7, {width} x {height}: median {np.median(times):.0f} ms, "
                f"largest {times.max():.0f} ms"
            )
            page.close()
        browser.close()
    viewer.close()


if __name__ == "__main__":
    main()
