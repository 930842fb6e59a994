"""How fast the page follows: readout and map behind a slider, and frames of a motion in play.

    python benchmarks/view.py        # needs pip install -e '.[test]' and chromium

Headless chromium draws with the processor, beside the server on the same cores: a graphics card
takes most of that away. The slider moves 40 times; median and largest time, for two windows. Then a
joint moves that is not on the map of two joints, 20 times, until the new map is drawn; the scene is
not drawn meanwhile, which a graphics card would do. Then a motion plays whose drawing calls do
nothing: how many frames a second show a posture of their own, of at most 60, and what a frame costs
the page's main thread. Chromium still puts the page together with the processor, which is what
takes long in large windows. First the size of
saved pages, without meshes (chaser7) and with them.
"""

from __future__ import annotations

from shutil import which
from types import SimpleNamespace

import numpy as np
from playwright.sync_api import Browser, sync_playwright

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

NO_CALLS = """
for (const { prototype } of [WebGLRenderingContext, WebGL2RenderingContext])
  for (const call of ["drawElements", "drawArrays", "clear"]) prototype[call] = () => {};
"""
PLAY = """async () => {
  const time = document.querySelector("#motion input");
  const begun = performance.now();
  let [frames, shown] = [0, time.value];
  while (performance.now() < begun + 4000) {
    await new Promise((done) => requestAnimationFrame(done));
    if (time.value !== shown) frames++;
    shown = time.value;
  }
  return [frames, (performance.now() - begun) / 1000];
}"""

DRAWING = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
NO_DRAWING = ["--no-sandbox", "--disable-3d-apis"]
WINDOWS = ((420, 320), (1366, 768), (1920, 1080))
MAPPED = ("planar3", "mda6", "chaser7", "dual_ur5")


def swinging(name: str) -> SimpleNamespace:
    """Return a motion of all joints, 8 s long."""
    cfg = sa.load(name).at(np.full(sa.load(name).n, 0.3))
    q = cfg.q + 0.4 * np.sin(0.2 * np.arange(81)[:, None] + np.arange(cfg.arm.n))
    cfgs = [cfg]
    cfgs += [cfg := sa.move(cfg, row) for row in q]
    t = np.linspace(0.0, 8.0, len(cfgs))
    return SimpleNamespace(arm=cfg.arm, t=t, q=[c.q for c in cfgs], base=[c.base for c in cfgs])


def play(browser: Browser, name: str, size: tuple[int, int]) -> None:
    """Print how many frames of a motion in play the page shows in a second."""
    viewer = sa.view(swinging(name), open=False)
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    page.add_init_script(NO_CALLS)
    page.goto(viewer.serve())
    page.wait_for_selector("body[data-ready=yes]", state="attached")
    page.wait_for_timeout(2000)
    tools = page.context.new_cdp_session(page)
    tools.send("Performance.enable")

    def worked() -> float:
        """Processor time of the main thread [ms]."""
        metrics = tools.send("Performance.getMetrics")["metrics"]
        return 1e3 * next(each["value"] for each in metrics if each["name"] == "ThreadTime")

    page.click("#motion button")
    page.wait_for_timeout(1500)
    before = worked()
    frames, seconds = page.evaluate(PLAY)
    print(
        f"play, {name}, {size[0]} x {size[1]}: {frames / seconds:.0f} frames a second, "
        f"{(worked() - before) / frames:.1f} ms of the main thread each"
    )
    page.close()
    viewer.close()


def main() -> None:
    for name in ("chaser7", "dual_ur5"):
        size = len(sa.view(sa.load(name), open=False).html().encode())
        print(f"saved page, {name}: {size / 1e6:.1f} MB")
    with sync_playwright() as playwright:
        for name, sizes, what, script, options in (
            ("chaser7", WINDOWS, "readout", MEASURE, DRAWING),
            ("dual_ur5", WINDOWS[1:], "readout", MEASURE, DRAWING),
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
        browser = playwright.chromium.launch(executable_path=which("chromium"), args=DRAWING)
        for name in ("chaser7", "dual_ur5"):
            for size in WINDOWS:
                play(browser, name, size)
        browser.close()


if __name__ == "__main__":
    main()
