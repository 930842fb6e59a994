"""Hostile commands: a few words of a command line wrong."""

from __future__ import annotations

import io
import re
import sys
import traceback
import warnings
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
from hostile import FaultError
from hostile_files import TINY, Here
from mutations import HOSTILE, mutated, renamed, urdf_sources

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    import spacearm.cli.views
    import spacearm.sweeps.runner
    import spacearm.viewer.viewer
    from spacearm.cli import app as cli
from spacearm.description.model_catalogue import models_folder
from spacearm.errors import ModelWarning

PLAIN = [models_folder() / "planar2.urdf"]
"""Its two joints fit the numbers of most commands."""
COMMANDS = (
    "models", "models --json", "info planar2 --deg", "info robot.urdf --json",
    "query planar2 --deg -65 -11.41", "query mda6 0 1 0 1 0 1 --json --attitude 0 0 0.5",
    "query robot.urdf 0.1 0.2 --tip hand --task x/2 --lock joint_1=0.5 --check warn",
    "query planar2 0.1 0.2 --base fixed --tolerance 0.1", "map planar2 --points 9 --output map.svg",
    "map planar3 --axes q1 q2 --fix q3=0.4 --points 9 --npz map.npz",
    "workspace planar2 --base free-floating --output work.svg", "workspace planar2 --path path.txt",
    "design planar2 --vary base_inertia=1:2:2 --vary mount_x=0.1 --output design.svg --json",
    "simulate planar2 --deg -57 60 --target 1.5 1.5 --duration 0.5 --output sim.svg",
    "simulate planar2 0.3 0.9 --target 0.5 0.5 --controller JointPD --duration 0.2 --with "
    "controller.kp=[1,2] --with controller.kd=1 --save sim.npz --json",
    "simulate planar2 0.3 0.9 --target 1 1 --controller DampedLeastSquares --duration 0.2 "
    "--with controller.gain=1 --with stop=target --with integration.rtol=1e-6 --json",
    "plan planar2 --deg -57 60 --goal 1.5 1.5 --with origin=cm --with search.timeout=2 "
    "--json --save plan.npz",
    "view planar2 0.1 0.2 --no-open --port 7470", "view robot.urdf --save page.html",
    "map robot.urdf --points 9 --task pose --npz map.npz",
    "workspace robot.urdf --effort 20 --limits", "workspace robot.urdf --task x --effort 20",
    "simulate robot.urdf 0.1 0.2 --target 0.2 0.1 --controller JointPD --duration 0.1",
    "plan robot.urdf 0.1 0.2 --goal 1 1 --task x --with search.timeout=1 --save plan.npz",
    "design robot.urdf --vary base_inertia=1:2:2 --effort 20",
    "sweep study.toml --store run.zarr --workers 1", "sweep study.toml --store run.zarr --status",
    "sweep study.toml --store run.zarr --dry-run", "sweep study.toml --store path.txt",
    "nearest planar2 0.3 0.9 --json", "nearest robot.urdf 0.1 0.2 --task x",
    "box planar2 0.3 1.2 --at-least 0.05 --json", "path planar2 path.txt --json",
    "boxes planar2 0.3 1.2 --to 0.5,1.5 --share 0.3 --json",
    "risk planar2 --samples 50 --distance 0.1 --json", "capture planar2 0.3 0.9 --mass 5 --json",
    "follow planar2 0.3 0.9 --path path.txt --json", "reaction planar2 --motion path.txt",
    "wheels planar2 --tip-speed 0.1 --samples 20", "identify planar2 --motion path.txt",
    "watch planar2 path.txt --json", "watch robot.urdf path.txt --stop 0.1 --ahead 2",
    "attitudes planar2 0.3 0.9 --corner 1.2 0.6 --corner 1.0 0.9 --samples 8",
    "catch chaser7 0 0.6 0 1.2 0 0.8 0 --target study.toml --with search.timeout=1",
    "hold planar2 0.3 0.9 --target study.toml --grasp tip=side",
    "detumble robot.urdf 0.3 0.9 --goal 1.2 0.9 --with search.timeout=1",
    "convert robot.urdf again.sdf", "convert robot.urdf again.xml --check accept",
    "export robot.urdf --c code", "mount vispa --mass 200 --size 1,1,1 --output again.urdf",
)  # fmt: skip
WORK = ("--duration", "--points", "--effort", "--vary")
"""How much is asked for by their values is the user's affair."""
PICTURE = re.compile(r".*_[a-z]+\.(png|svg|html)")
"""What is written where no name is given."""
TEXTS = re.compile(r"(spacearm: (error|warning|note): .*|stopped: .*)")
SLOW = re.compile(r"spacearm: .*: (\d+ %, )?(\d+ s so far(, at most \d+ s more)?|about \d+ s left)")
"""What a slow machine says besides."""


def commands(rng: np.random.Generator, folder: Path, named: set[str]) -> None:
    """A command with some words wrong: exit code 0, or 2 and one line."""
    words = str(rng.choice(COMMANDS)).split()
    others = [word for text in COMMANDS for word in text.split() if word not in WORK]
    for _ in range(rng.integers(0, 4)):
        at, kind = int(rng.integers(0, len(words) + 1)), rng.integers(4)
        if any(word in WORK for word in words[max(at - 1, 0) : at + 1]):
            continue
        word = str(rng.choice(HOSTILE if rng.random() < 0.5 else others)).replace("\x00", "")
        if kind == 0:
            words.insert(at, word)
        elif kind == 1:
            words[at : at + 1] = [word]
        elif at < len(words):
            words[at : at + 1] = [] if kind == 2 else [words[at], words[at]]
    sources = urdf_sources() if rng.random() < 0.5 else PLAIN
    source = sources[rng.integers(len(sources))].read_text(encoding="utf-8")
    if rng.random() < 0.3:
        source = renamed(source, rng)
    Path("robot.urdf").write_bytes(mutated(source, rng) if rng.random() < 0.5 else source.encode())
    Path("study.toml").write_text(TINY, encoding="utf-8")
    Path("path.txt").write_bytes(b"0 1\n1 2\n" + rng.bytes(rng.integers(0, 3)))
    named.update(path.name for path in folder.iterdir())
    named.update(
        Path(word).as_posix() for text in words for word in (text, text.rpartition("=")[2])
    )
    checked(words)
    named.update(path.name for path in folder.iterdir() if PICTURE.fullmatch(path.name))


def checked(words: list[str]) -> None:
    """Runs a command: exit code 0, 2 with one line that begins with error, or 3, its answer."""
    code, said, complaint = spoken(words)
    lines = [line for line in complaint.splitlines() if not SLOW.fullmatch(line)]
    if code not in (0, 2, 3) or not all(TEXTS.fullmatch(line) for line in lines):
        raise FaultError(f"{words}: exit code {code}, {said[-200:]!r}, {complaint[-3000:]}")
    if not all(letter.isprintable() or letter in "\n\t" for letter in said + complaint):
        raise FaultError(f"{words}: commands the terminal by {said!r}, {complaint!r}")
    if (code == 2) != (sum("error" in line[:16] for line in lines) == 1):
        raise FaultError(f"{words}: exit code {code} with {complaint!r}")


def spoken(words: list[str]) -> tuple[int, str, str]:
    """Exit code, output and complaints of the command line, nothing served, nothing started."""
    spacearm.sweeps.runner.Processes = Here
    spacearm.cli.views.serve_until_interrupted = lambda *_: None
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.StringIO()
    sys.argv = ["spacearm", *words]
    with warnings.catch_warnings(), redirect_stdout(out), redirect_stderr(err):
        warnings.simplefilter("error")  # any but ours: the command line prints them all
        warnings.simplefilter("ignore", ModelWarning)
        # Matplotlib draws a box and says which character its font lacks
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        try:
            cli.main()
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
        except Exception:  # what a user would see as a traceback
            code = -1
            traceback.print_exc()
    out.flush()
    return code, out.buffer.getvalue().decode(), err.getvalue()
