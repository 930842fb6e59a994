"""A real browser: Debian's chromium, headless, driven by playwright."""

import os
import shutil

import pytest

OPTIONS = [
    "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-background-networking", "--no-first-run", "--disable-sync",
    "--disable-component-update",
]  # fmt: skip


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None and not os.environ.get("CI"):
        pytest.skip("no chromium on this machine")
    with playwright.sync_playwright() as tool:
        started = tool.chromium.launch(executable_path=chromium, args=OPTIONS)
        yield started
        started.close()
