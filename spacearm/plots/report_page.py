"""A design report: the arm, where it is singular, where it can work, what it does to its bus."""

from __future__ import annotations

import base64
import html
import io
import json
import os
import shlex
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from spacearm.arrays import Array, ArrayLike, Progress, counted
from spacearm.description.model_catalogue import source_of
from spacearm.errors import NoSolutionError, UnsupportedError
from spacearm.files import writable, write
from spacearm.mechanics.batch import evaluate
from spacearm.mission.level import level_envelope, level_reach
from spacearm.mission.reactions import size_wheels
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_vector
from spacearm.plots.show import plot
from spacearm.results import Column, Description, Table
from spacearm.signatures import checked
from spacearm.singularities.joint_boxes import free_box
from spacearm.singularities.map import singular_map
from spacearm.singularities.report import singularity
from spacearm.singularities.risk import risk_profile, uniform
from spacearm.singularities.sets import singular_set
from spacearm.workspaces.path_dependent import workspace

#: Singular configurations from which shells are searched, a tenth of what `workspace` takes.
EFFORT = 20_000
#: Configurations of the risk profile.
SAMPLES = 50_000
#: Effort of the proof of the box about the working posture, a tenth of what `free_box` takes.
BOX_EFFORT = 0.1
#: Postures of the wheel sizing.
POSTURES = 400
#: Postures from which the working posture is chosen.
CANDIDATES = 2000
#: Turns of the spacecraft for which the level reach is reported [deg].
TILTS = (0.5, 2.0, 5.0)
#: Speed of the tip for which wheels are sized [m/s] or [rad/s].
TIP_SPEED = 0.1
#: Masses of the bus that are compared, as shares of its own.
HEAVIER = (0.25, 0.5, 1.0, 2.0, 4.0)
#: Pictures that are larger as SVG are written as PNG [bytes].
LARGEST_SVG = 400_000
#: Dots per inch of PNG pictures.
DOTS = 150

#: Style sheet of the page.
STYLE = Path(__file__).with_name("report.css").read_text(encoding="utf-8")


@dataclass
class ReportSection:
    """A section of a report.

    Attributes:
        title: Its heading.
        blocks: Its content, HTML.
    """

    title: str
    blocks: list[str] = field(default_factory=list)

    @property
    def anchor(self) -> str:
        """Name by which the contents lead here."""
        return "".join(c if c.isalnum() else "-" for c in self.title.lower())

    def say(self, text: str, kind: str = "") -> None:
        """Add a paragraph; `kind` is its class."""
        name = f' class="{kind}"' if kind else ""
        self.blocks.append(f"<p{name}>{html.escape(text)}</p>")

    def show(self, said: Description | Table, command: str = "") -> None:
        """Add a description or a table, and the command that prints it."""
        self.blocks.append(said.to_html())
        self.blocks += [_command(command)] if command else []

    def picture(self, drawn: Figure, caption: str, command: str) -> None:
        """Add a figure with its caption, and the command that draws it."""
        words = html.escape(caption)
        image = f'<img src="{inside(drawn)}" alt="{words}">'
        self.blocks.append(f"<figure>{image}<figcaption>{words}</figcaption></figure>")
        self.blocks.append(_command(command))


def _command(command: str) -> str:
    return f'<p class="command"><code>{html.escape(command)}</code></p>'


def inside(drawn: Figure) -> str:
    """Return a figure as the address of an image that holds it."""
    kind, content = "svg+xml", _written(drawn, "svg")
    if len(content) > LARGEST_SVG:
        kind, content = "png", _written(drawn, "png")
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def _written(drawn: Figure, kind: str) -> bytes:
    buffer = io.BytesIO()
    metadata = {"Date": None} if kind == "svg" else {}
    drawn.savefig(buffer, format=kind, dpi=DOTS, metadata=metadata)
    return buffer.getvalue()


def page(title: str, about: str, sections: Sequence[ReportSection]) -> str:
    """Return the whole page."""
    links = "".join(
        f'<a href="#{section.anchor}">{html.escape(section.title)}</a>' for section in sections
    )
    parts = "".join(
        f'<section id="{section.anchor}"><h2>{html.escape(section.title)}</h2>'
        f"{''.join(section.blocks)}</section>"
        for section in sections
    )
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head><body>"
        f'<h1>{html.escape(title)}</h1><p class="about">{html.escape(about)}</p>'
        f"<nav>{links}</nav>{parts}</body></html>\n"
    )


@checked
def design_report(
    arm: SpaceArm,
    path: str | os.PathLike[str],
    *,
    q0: ArrayLike | None = None,
    words: Sequence[str] | None = None,
    on_section: Callable[[str, float | None], object] | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write a design report of an arm: one HTML page with everything inside it.

    It shows the arm, its singular sets, joint ranges without singular posture, its workspaces and
    the share of postures near singularities. Then come the turn of the bus by straight lines of the
    tip, and wheels that would hold the attitude. Beneath every figure stands the command that makes
    it. If a result does not exist for the arm, the page says why.

    Args:
        arm: The arm.
        path: The page to write.
        q0: (n,) the working posture, from which lines of the tip go; the one farthest from
            singularities of 2,000 within the joint limits if None.
        words: The arguments that describe the arm on the command line, for the commands in the
            report; its file's path or catalogue name if None.
        on_section: Called as on_section(title, None) when a section is begun, and as
            on_section(title, seconds) when it is done.
        progress: Called as progress(done, most).

    Returns:
        The path.

    Raises:
        ConfigurationError: q0 has the wrong shape or is not finite.
        UnsupportedError: The arm has several tips.
        SpaceArmError: The file cannot be written.

    Example:
        >>> import spacearm as sa
        >>> sa.design_report(sa.load("planar2"), "report.html").name
        'report.html'
    """
    arm.require_one_tip()
    writable(Path(path))
    about = shlex.join(words if words is not None else [source_of(arm.name, arm.path)])
    q = _working_posture(arm) if q0 is None else joint_vector(arm, q0, "q0")
    parts: list[tuple[str, Callable[[ReportSection], None]]] = [
        ("The arm", lambda s: _arm(s, arm, q, about)),
        ("Where it is singular", lambda s: _singular(s, arm, q, about)),
        ("Where nothing is singular", lambda s: _ranges(s, arm, q, about, within)),
        ("Where it can work", lambda s: _workspaces(s, arm, about)),
        ("Risk by distance", lambda s: _risk(s, arm, about)),
        ("Turning the spacecraft", lambda s: _reaction(s, arm, q, about)),
        ("Wheels that hold the attitude", lambda s: _wheels(s, arm, about)),
    ]

    def within(done: int, most: int) -> None:
        if progress:
            progress(len(sections) * most + done, len(parts) * most)

    sections, begun = list[ReportSection](), time.perf_counter()
    for title, fill in counted(parts, progress):
        section, started = ReportSection(title), time.perf_counter()
        if on_section:
            on_section(title, None)
        try:
            fill(section)
        except (UnsupportedError, NoSolutionError) as reason:
            section.say(f"Not available: {reason}.", "missing")
        sections.append(section)
        if on_section:
            on_section(title, time.perf_counter() - started)
    from spacearm import __version__

    when = datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC")
    took = time.perf_counter() - begun
    line = f"spacearm {__version__}, {when}, computed in {took:.0f} s. Not checked: collisions."
    text = page(f"{arm.name}: design report", line, sections)
    return write(Path(path), text.encode())


def _working_posture(arm: SpaceArm) -> Array:
    """Return the posture farthest from singularities, of some within the limits."""
    Q = uniform(arm, True, CANDIDATES, np.random.default_rng(0))
    distance = evaluate(arm, Q, ("distance",))["distance"]
    distance = np.where(np.isfinite(distance), distance, -1.0)
    return Q[int(np.argmax(distance))]


def _numbers(q: Array, between: str = ", ") -> str:
    """Return joint positions as they are typed."""
    return between.join(f"{x:.6g}" for x in q)


def _at(q: Array) -> str:
    """Return the expression of a posture."""
    return f"arm.at([{_numbers(q)}])"


def _python(about: str, expression: str) -> str:
    """Return a command that draws an expression of an arm."""
    name, *options = shlex.split(about)
    code = f"import spacearm as sa; arm = sa.load({json.dumps(name)}); sa.plot({expression})"
    code += '.savefig("x.svg")'
    loaded = f"  # load it as by {shlex.join(options)}" if options else ""
    return f"python -c {shlex.quote(code)}{loaded}"


def _arm(section: ReportSection, arm: SpaceArm, q: Array, about: str) -> None:
    section.show(arm.describe(), f"spacearm info {about}")
    report = singularity(arm.at(q), exact=True)
    section.picture(
        plot(report.configuration),
        "The working posture of this report.",
        _python(about, _at(q)),
    )
    section.show(report.describe(), f"spacearm query {about} {_numbers(q, ' ')}")


def _singular(section: ReportSection, arm: SpaceArm, q: Array, about: str) -> None:
    found = singular_set(arm)
    Q = uniform(arm, True, SAMPLES, np.random.default_rng(1))
    share = evaluate(arm, Q, ("distance",))["distance"]
    near = [(bound, np.mean(share <= bound)) for bound in np.radians((1, 5, 10, 20))]
    section.show(found.describe())
    columns = (
        Column("postures within the limits nearer, to first order, than", "rad"),
        Column("share", "", ".2%"),
    )
    section.show(Table(columns, near))
    section.picture(
        plot(singular_map(arm, None, q, 121)),
        "Joint motion to a singular posture, to first order, over the two joints that change "
        "sigma_min most, the others as in the working posture.",
        _python(about, f"sa.singular_map(arm, q=[{_numbers(q)}])"),
    )
    section.picture(plot(found), "The singular set.", _python(about, "sa.singular_set(arm)"))


def _ranges(
    section: ReportSection, arm: SpaceArm, q: Array, about: str, progress: Progress
) -> None:
    if beyond := arm.at(q).outside_limits:
        section.say(f"The working posture is beyond the limits of {', '.join(beyond)}.", "missing")
        return
    box = free_box(arm.at(q), effort=BOX_EFFORT, progress=progress)
    section.say(
        "Joint ranges about the working posture in which no posture is singular: within them any "
        "motion of the joints is free, whoever plans it."
    )
    section.show(box.describe(), f"spacearm box {about} {_numbers(q, ' ')} --effort {BOX_EFFORT}")
    section.picture(
        plot(box),
        "The ranges (green) within the joint limits, or one turn.",
        _python(about, f"sa.free_box({_at(q)}, effort={BOX_EFFORT})"),
    )


def _workspaces(section: ReportSection, arm: SpaceArm, about: str) -> None:
    found = workspace(arm, effort=EFFORT)
    command = f"spacearm workspace {about} --effort {EFFORT}"
    section.show(found.describe())
    section.picture(plot(found), "The workspaces about the system CM.", command)


def _risk(section: ReportSection, arm: SpaceArm, about: str) -> None:
    profile = risk_profile(arm, limits=True, samples=SAMPLES)
    section.say(
        "The share of postures within the joint limits for which a search finds a singular posture "
        "within 5°, by the distance of the tip from the system CM."
    )
    section.picture(
        plot(profile),
        f"{SAMPLES:,} uniform postures; the band is two standard errors.",
        _python(about, f"sa.risk_profile(arm, limits=True, samples={SAMPLES})"),
    )


def _reaction(section: ReportSection, arm: SpaceArm, q: Array, about: str) -> None:
    reaches = [level_reach(arm.at(q), t, directions=_rays(arm)) for t in np.radians(TILTS)]
    reach = reaches[-1]
    section.say(
        "How far the tip goes from the working posture, along straight lines in all directions and "
        "its attitude kept, until the floating spacecraft has turned by an angle (or a singularity "
        "or a joint limit is met)."
    )
    lines = [found.straight for found in reaches]
    section.show(
        Table.by_columns(
            {
                Column("turned by", "rad"): np.radians(TILTS),
                Column("worst", "m", ".4g"): [x.min() for x in lines],
                Column("mean", "m", ".4g"): [x.mean() for x in lines],
                Column("best", "m", ".4g"): [x.max() for x in lines],
            }
        ),
        _python(about, f"sa.level_reach({_at(q)}, {np.radians(TILTS[1]):.6g})"),
    )
    section.picture(
        plot(reach),
        f"Where the tip goes with a turn of up to {TILTS[-1]:g}°.",
        _python(about, f"sa.level_reach({_at(q)}, {np.radians(TILTS[-1]):.6g})"),
    )
    bus = float(arm.model.inertias[1].mass)
    masses = [round(share * bus, 6) for share in HEAVIER]
    tilts = [float(np.radians(tilt)) for tilt in TILTS]
    envelope = level_envelope(arm.at(q), tilts, masses, directions=_rays(arm) // 2)
    section.picture(
        plot(envelope),
        "The same over the mass of the bus, whose inertia grows as mass^(5/3); on the right the "
        f"turn by {envelope.travel:g} m of the tip.",
        _python(about, f"sa.level_envelope({_at(q)}, {[round(t, 6) for t in tilts]}, {masses})"),
    )


def _rays(arm: SpaceArm) -> int:
    """Return how many directions are taken."""
    return 72 if arm.tree.plane_normal() is not None else 200


def _wheels(section: ReportSection, arm: SpaceArm, about: str) -> None:
    found = size_wheels(arm, tip_speed=TIP_SPEED, samples=POSTURES)
    command = f"spacearm wheels {about} --tip-speed {TIP_SPEED:g} --samples {POSTURES}"
    section.say(
        "The momentum that wheels need to hold the attitude while the tip moves in the worst "
        "direction; it grows in proportion to the speed of the tip."
    )
    section.show(found.describe())
    section.picture(plot(found), "Postures covered by the momentum of the wheels.", command)
