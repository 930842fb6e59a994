"""The phases of a flight simulated, and what is printed of it."""

from __future__ import annotations

from pathlib import Path

from spacearm.arrays import Array
from spacearm.cli.output import (
    out,
    print_json,
    say_stopped,
    table,
    vector,
    working,
    write_picture,
)
from spacearm.cli.wording import INTERRUPTED
from spacearm.model.arm import Configuration
from spacearm.motion.flights import Flight, Phase, simulate_phases


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
    if as_json:
        print_json(flight.to_dict())
    else:
        print_flight(flight)
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


def print_flight(flight: Flight) -> None:
    """Print the phases and what happened."""
    end = flight.begins[-1] + flight.phases[-1].t[-1]
    out.print(f"{flight.phases[0].arm.name}: {end:.6g} s, ended by {flight.ended}")
    rows = table("phase", "from [s]", "to [s]", "ended by", "tip at the end [m]", "energy off by")
    for i, (run, begin) in enumerate(zip(flight.phases, flight.begins, strict=True)):
        tip = vector(run[-1].tip.translation) if len(run.arm.tips) == 1 else "several"
        rows.add_row(str(i), f"{begin:.4g}", f"{begin + run.t[-1]:.4g}", run.ended, tip,
                     f"{run.imbalance:.1e}")  # fmt: skip
    out.print(rows)
    if flight.events:
        rows = table("event", "time [s]", "")
        for event in flight.events:
            rows.add_row(event.kind, f"{event.t:.4f}", event.detail)
        out.print(rows)
