"""The phases of a flight simulated, and what is printed of it."""

from __future__ import annotations

from pathlib import Path

from spacearm.arrays import Array
from spacearm.cli.output import (
    print_result,
    say_stopped,
    working,
    write_picture,
)
from spacearm.cli.wording import INTERRUPTED
from spacearm.model.arm import Configuration
from spacearm.motion.flights import Phase, simulate_phases


def fly(
    start: Configuration,
    phases: list[Phase],
    dq: Array | None,
    save: Path | None,
    output: Path | None,
    view: bool,
    as_json: bool,
) -> int:
    """Simulate the phases, print, save, draw and show them; return the exit code.

    Files get the number of their phase.
    """
    with working("simulating") as progress:
        flight = simulate_phases(start, phases, dq=dq, progress=progress)
    print_result(flight, as_json=as_json)
    for i, run in enumerate(flight.phases):
        if save:
            run.save(save.with_stem(f"{save.stem}_{i}"))
        if output:
            from spacearm.plots.motions import draw_motion

            write_picture(output.with_stem(f"{output.stem}_{i}"), draw_motion(run, None))
    if view:
        from spacearm.cli.views import serve_until_interrupted
        from spacearm.viewer.show import view as show

        serve_until_interrupted(show(flight, open=False))
    if flight.ended == "interrupted":
        say_stopped(f"{len(flight.phases)} of {len(phases)} phases simulated")
        return INTERRUPTED
    return 0
