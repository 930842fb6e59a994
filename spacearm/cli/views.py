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
    q: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[Q1 Q2 ...]",
            help="Joint values [rad], with --deg in degrees; of sliding joints [m]. Or home, the "
            "home positions of the joints. Default: home if the robot's file states positions "
            "other than zero, else a regular posture.",
        ),
    ] = None,
    attitude: opt.Attitude = None,
    motion: Annotated[
        Path | None,
        typer.Option(metavar="NPZ", help="Play a motion written by --save of plan or simulate."),
    ] = None,
    compare: Annotated[
        str | None,
        typer.Option(
            metavar="NPZ|MODE",
            help="Play another motion in step, or the same joint motion in another mode: "
            f"{KNOWN_MODES}.",
        ),
    ] = None,
    fly: Annotated[
        bool, typer.Option("--fly", help="Begin by teleoperating the tip with keyboard or gamepad.")
    ] = False,
    port: Annotated[
        int | None,
        typer.Option(help="Port of the viewer. Default: the first free one from 7400 on."),
    ] = None,
    no_open: Annotated[
        bool, typer.Option("--no-open", help="Serve the viewer; do not open a browser.")
    ] = False,
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="HTML", help="Write one self-contained page and exit.", callback=opt.to_write
        ),
    ] = None,
    png: Annotated[
        Path | None,
        typer.Option(metavar="PNG", help="Write a picture and exit.", callback=opt.to_write),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            metavar="MP4|WEBM|GIF|ZIP",
            help="Write a video of the motion and exit, or pictures (ZIP); 25 per second.",
            callback=opt.to_write,
        ),
    ] = None,
    deg: bool = False,
) -> None:
    """Show a posture or play a motion in the viewer."""
    if save or png or video:
        served = {"--port": port, "--no-open": no_open, "--fly": fly}
        opt.refuse_unused(served, "without --save, --png and --video, which write files and exit")
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
