"""A page in a real browser, for tests: what it shows, and what it asked for."""

import time


class Page:
    """A page that remembers what it asked for and what went wrong."""

    def __init__(self, browser, url, width=700, height=600, **options):
        self.context = browser.new_context(
            viewport={"width": width, "height": height}, **options
        )  # fmt: skip
        self.context.set_default_timeout(120_000)  # of a machine with much else to do
        self.page = self.context.new_page()
        self.requests, self.errors = [], []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda m: self.errors.append(m.text) if m.type == "error" else None)
        self.page.goto(url)
        self.url = url

    def ready(self):
        self.page.wait_for_selector("body[data-ready=yes]", state="attached")
        return self

    def text(self, selector):
        return self.page.text_content(selector)

    def move(self, index, degrees):
        """Moves a slider as a hand does: the value, then the event; waits for the answer."""
        wanted = f"{degrees:.2f}"
        number = f".joint:nth-child({index + 1}) input[type=number]"
        self.page.eval_on_selector(
            f".joint:nth-child({index + 1}) input[type=range]",
            f"s => {{ s.step = 'any'; s.value = {degrees}; s.dispatchEvent(new Event('input')); }}",
        )
        self.page.wait_for_function(
            f"() => document.querySelector('{number}').value === '{wanted}'"
        )

    def wait_text(self, selector, text):
        """Waits until an element holds a text."""
        self.page.wait_for_function(
            "([selector, text]) => document.querySelector(selector)?.textContent.includes(text)",
            arg=[selector, text],
        )

    def until(self, holds, seconds=120.0):
        """Waits until what is asked holds, while the page goes on."""
        end = time.monotonic() + seconds
        while not holds():
            assert time.monotonic() < end, "it never came to hold"
            self.page.wait_for_timeout(30)

    def seek(self, t):
        """Drags the time slider."""
        self.page.eval_on_selector(
            "#motion input", f"s => {{ s.value = {t}; s.dispatchEvent(new Event('input')); }}"
        )
        self.wait_text("#motion output", f"{t:.2f} s")

    def visible(self, *path):
        """Whether an object of the drawing is visible."""
        return self.page.evaluate(
            "path => window.spacearm.viewer.scene_tree.find(path).object.visible",
            ["spacearm", *path],
        )

    def wait_visible(self, *path, wanted=True):
        self.page.wait_for_function(
            "([path, on]) => window.spacearm.viewer.scene_tree.find(path).object.visible === on",
            arg=[["spacearm", *path], wanted],
        )

    def colours(self):
        """How many different colours the drawing has: an empty screen has few."""
        return self.page.evaluate(
            """async () => {
              const image = new Image();
              image.src = window.spacearm.viewer.capture_image();
              await image.decode();
              const canvas = new OffscreenCanvas(image.width, image.height);
              const context = canvas.getContext("2d");
              context.drawImage(image, 0, 0);
              const data = context.getImageData(0, 0, image.width, image.height).data;
              const seen = new Set();
              for (let i = 0; i < data.length; i += 4)
                seen.add((data[i] >> 4) * 256 + (data[i + 1] >> 4) * 16 + (data[i + 2] >> 4));
              return seen.size;
            }"""
        )

    def close(self):
        self.context.close()
