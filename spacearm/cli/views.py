"""`spacearm view`: a configuration or a motion in the browser, in a file, or as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import spacearm as sa
from spacearm.cli import options as opt
from spacearm.cli.output import out, serve_until_interrupted, undisturbed, working
from spacearm.closure.holding import closed_by_itself
from spacearm.viewer.motions import WORDS
from spacearm.viewer.session import opening_posture
from spacearm.viewer.show import view as show

KNOWN_MODES = ", ".join(WORDS)


@opt.on_a_model
def view_configuration(
    arm: sa.SpaceArm,
    q: Annotated[list[str] | None, typer.Argument()] = None,
    attitude: opt.Attitude = None,
    motion: Path | None = None,
    compare: str | None = None,
    fly: bool = False,
    port: int | None = None,
    no_open: bool = False,
    save: opt.Written = None,
    png: opt.Written = None,
    video: opt.Written = None,
    deg: bool = False,
) -> None:
    """Show a posture or play a motion in the browser.

    The page has sliders for the joints. If the robot's file closes a chain, they keep it closed.
    Ctrl-C closes the page.

    Options:
        q ([Q1 Q2 ...]): Joint values [rad], with --deg in degrees; of sliding joints [m]; a
            regular posture by default.
        motion (NPZ): Play a motion written by --save of plan or simulate.
        compare (NPZ|MODE): Play another motion in step, or the same joint motion in another mode:
            {KNOWN_MODES}.
        fly: Begin by flying the tip with keyboard or gamepad.
        port: Port of the page; by default the first free one from 7400 on.
        no_open: Serve the page, do not open a browser.
        save (HTML): Write one self-contained page and exit.
        png (PNG): Write a picture and exit.
        video (MP4|WEBM|GIF|ZIP): Write a video of the motion and exit, or pictures (ZIP); 25 per
            second.
    """
    with undisturbed():
        if motion:
            if q or attitude:
                raise sa.ConfigurationError(
                    "the motion has its own postures; leave out q and --attitude"
                )
            given = compare is None or compare in WORDS
            other = compare if given else sa.Motion.load(str(compare), arm)
            viewer = show(sa.Motion.load(motion, arm), compare=other, open=False)
        elif compare:
            raise sa.ConfigurationError("there is no motion to compare; give --motion")
        else:
            start = opt.joint_values(arm, q, deg) if q else opening_posture(arm)
            cfg = arm.at(start, base=opt.spacecraft_pose(attitude, deg))
            viewer = show(closed_by_itself(cfg) or cfg, open=False)
    viewer.session.fly = fly
    if save:
        out.print(f"wrote {viewer.save(save)}")
    if png:
        out.print(f"wrote {viewer.png(png)}")
    if video:
        what, film = (
            ("pictures", viewer.frames)
            if video.suffix.lower() == ".zip"
            else ("video", viewer.video)
        )
        with working(what) as progress:
            film(video, progress=progress)
        out.print(f"wrote {video}")
    if save or png or video:
        return
    serve_until_interrupted(viewer, port, no_open)
