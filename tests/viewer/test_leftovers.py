"""Nothing is left of pictures and videos: no process, no unfinished file, no folder."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import spacearm as sa

BROWSER = """#!{python} -ES
import base64, os, struct, sys, time, zlib

def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

head = struct.pack(">IIBBBBB", 4, 4, 8, 2, 0, 0, 0)
rows = zlib.compress((b"\\0" + 4 * b"abc") * 4)
png = b"\\x89PNG\\r\\n\\x1a\\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
options = dict(word.partition("=")[::2] for word in sys.argv[1:] if word.startswith("--"))
profile = options["--user-data-dir"]
os.mkdir(os.environ["TMPDIR"] + "/org.chromium")
with open({pids!r}, "a") as pids:
    print(os.getpid(), file=pids)
if os.fork() == 0:  # what goes on writing to the profile
    with open({pids!r}, "a") as pids:
        print(os.getpid(), file=pids)
    os.close(2)
    while True:
        os.makedirs(profile, exist_ok=True)
        open(profile + "/" + str(time.monotonic()), "w").close()
if "--screenshot" in options:
    open(options["--screenshot"], "wb").write(png)
    {then_a_picture}
else:
    for _ in sys.argv[-1].partition("frames=")[2].split(",")[2:]:
        text = base64.b64encode(png).decode()
        print('[1:CONSOLE] "picture ' + text + '!"', file=sys.stderr, flush=True)
        {then_a_frame}
time.sleep({then})
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Folders for a browser, for temporary files and for results; and the browser's processes."""
    for name in ("bin", "tmp", "out"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), prepend=os.pathsep)
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setattr("tempfile.tempdir", None)
    return tmp_path


def make_browser(place, **then):
    """Write a browser whose pictures are squares, which does other things then: Python code."""
    then = {"then": 0, "then_a_picture": "pass", "then_a_frame": "pass"} | then
    browser = place / "bin" / "chromium"
    browser.write_text(BROWSER.format(python=sys.executable, pids=str(place / "pids"), **then))
    browser.chmod(0o755)


def check_nothing_is_left(place, results):
    assert [*(place / "tmp").iterdir()] == []
    assert {path.name for path in (place / "out").iterdir()} == results
    numbers = (place / "pids").read_text().split()
    assert numbers
    deadline = time.monotonic() + 60
    for number in numbers:  # zombies have no command
        while (line := Path(f"/proc/{number}/cmdline")).exists() and line.read_bytes():
            assert time.monotonic() < deadline, f"{number} still runs"
            time.sleep(0.01)


def motion():
    return sa.Motion(sa.load("planar2"), [0.0, 1.0], np.array([[0, 1], [1, 1]]), np.eye(7)[[6, 6]])


linux = pytest.mark.skipif(not Path("/proc/self").exists(), reason="processes are found in /proc")


@linux
@pytest.mark.parametrize("kind", ["png", "zip", "gif"])
def test_of_what_succeeds(place, kind):
    make_browser(place)
    viewer = sa.view(motion(), open=False)
    write = {"png": viewer.png, "zip": viewer.frames, "gif": viewer.video}[kind]
    write(place / "out" / f"scene.{kind}", (4, 4))
    check_nothing_is_left(place, {f"scene.{kind}"})


@linux
@pytest.mark.parametrize("kind", ["png", "zip", "gif"])
def test_of_what_fails(place, kind):
    make_browser(place, then_a_picture="os.remove(options['--screenshot'])", then_a_frame="break")
    viewer = sa.view(motion(), open=False)
    write = {"png": viewer.png, "zip": viewer.frames, "gif": viewer.video}[kind]
    with pytest.raises(sa.SpaceArmError, match=r"the browser drew (nothing|2 of 26 pictures)"):
        write(place / "out" / f"scene.{kind}", (4, 4))
    check_nothing_is_left(place, set())


@linux
@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "number"),
    [("png", "SIGINT"), ("zip", "SIGTERM"), ("gif", "SIGHUP"), ("mp4", "SIGQUIT")],
)
def test_of_what_a_signal_ends(place, kind, number):
    if kind == "mp4":
        pytest.importorskip("imageio_ffmpeg")
    wait = "time.sleep(600)"
    make_browser(place, then_a_picture=wait, then_a_frame=wait)
    motion().save(place / "motion.npz")
    option = {"png": "--png"}.get(kind, "--video")
    words = ["--motion", place / "motion.npz", option, place / "out" / f"scene.{kind}"]
    command = [sys.executable, "-m", "spacearm", "view", "planar2", *words]
    run = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(getattr(signal, number), signal.SIG_DFL),
    )  # fmt: skip
    deadline = time.monotonic() + 300
    while not (place / "pids").exists() or len((place / "pids").read_text().split()) < 2:
        assert time.monotonic() < deadline
        assert run.poll() is None, run.communicate()
        time.sleep(0.01)
    assert [path.suffix for path in (place / "out").iterdir()] == [".partial"]
    run.send_signal(signal.Signals[number])
    run.send_signal(signal.Signals[number] if number == "SIGHUP" else 0)  # as terminals do
    _, errors = run.communicate(timeout=300)
    assert run.returncode == 128 + signal.Signals[number]
    assert "spacearm: stopped" in errors
    assert "Traceback" not in errors
    check_nothing_is_left(place, set())


@linux
@pytest.mark.slow
def test_browsers_end_with_a_process_that_is_killed(place):
    wait = "time.sleep(600)"
    make_browser(place, then_a_picture=wait)
    command = [sys.executable, "-m", "spacearm", "view", "planar2", "--png", place / "out/p.png"]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    deadline = time.monotonic() + 300
    while not (place / "pids").exists() or len((place / "pids").read_text().split()) < 2:
        assert time.monotonic() < deadline
        assert run.poll() is None, run.communicate()
        time.sleep(0.01)
    browser, child = (int(number) for number in (place / "pids").read_text().split())
    run.kill()
    run.communicate(timeout=300)
    os.kill(child, signal.SIGKILL)  # of a real browser the other processes notice that it has ended
    line = Path(f"/proc/{browser}/cmdline")
    while line.exists() and line.read_bytes():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@linux
@pytest.mark.slow
@pytest.mark.skipif(not any(Path("/usr/bin").glob("*chrom*")), reason="there is no browser")
@pytest.mark.parametrize("kind", ["png", "zip", "gif"])
def test_of_what_a_real_browser_draws(place, kind):
    (place / "pids").write_text(str(os.getpid() + 10**7))
    viewer = sa.view(motion(), open=False)
    write = {"png": viewer.png, "zip": viewer.frames, "gif": viewer.video}[kind]
    options = {} if kind == "png" else {"per_second": 2.0}
    write(place / "out" / f"scene.{kind}", (80, 60), **options)
    check_nothing_is_left(place, {f"scene.{kind}"})
