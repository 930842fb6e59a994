"""Show: any result with a posture in the browser, in notebooks, in files and pictures."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import pinocchio as pin

from spacearm.collisions.obstacles import ObstacleLike
from spacearm.errors import ConfigurationError, type_of
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.motion import Motion
from spacearm.signatures import checked

if TYPE_CHECKING:
    from spacearm.viewer.session import Session
    from spacearm.viewer.viewer import Viewer


@checked
def view(
    thing: Any,
    *,
    compare: Any = None,
    obstacles: ObstacleLike | Sequence[ObstacleLike] = (),
    port: int | None = None,
    open: bool | None = None,
) -> Viewer:
    """Show an arm with sliders, play a motion, or show the posture of any other result.

    In a script or a terminal the page opens in the browser, served on 127.0.0.1 only, until
    `Viewer.close` or the end of the program. As the last line of a cell it shows the page in a
    notebook; opened elsewhere, the notebook shows the scene as it was.

    Args:
        thing: One of

            - an arm: in a regular posture if it is singular at zeros, and closed if its file closes
              a chain;
            - a configuration, or a result that has one, such as a `Capture`;
            - a `Trajectory`, `Followed`, `Plan` or `Motion`, or any object with `arm`, `t`, `q`
              and `base`, which is played;
            - a `Flight`, whose phases are played one after the other;
            - a `Workspace`: cut open about the system CM, rings for planar arms;
            - a singular set: the arm at the singular posture nearest to zeros;
            - a `Region`: its first singular configuration;
            - `FeasibleAttitudes`: the motion along the path from the best of them, with all of them
              around the spacecraft;
            - a `Held`, or its report: the arms with the target, which can be dragged with the
              grasps closed; motions that its `follow`, `plan` and `simulate` return are played;
            - a `Catch`: its flight, with the tumbling target, its grapple frames and the stand-off.
        compare: What is played in step with a motion, as a ghost and dashed curves: another motion,
            or the same joint motion with the spacecraft "free-floating", "attitude-controlled" or
            "fixed".
        obstacles: What is drawn too, and what plans of the page keep off; as in `sa.plan`.
        port: Port of the page; the first free one from 7400 on if None.
        open: Whether to serve the page and open the browser. If None, a notebook gets it served,
            but opens no other window.

    Returns:
        A `Viewer`: `.url`, `.show`, `.shells`, `.compare`, `.obstacles`, `.save`, `.png`, `.close`.

    Raises:
        ConfigurationError: The thing cannot be shown or compared, or the motion or an obstacle
            makes no sense.
        SpaceArmError: The port is in use.

    Example:
        >>> import spacearm as sa
        >>> sa.view(sa.load("planar2").at([0.3, 1.2]), open=False)  # open=None: in the browser
        Viewer(planar2, not served)
    """
    rule = next((rule for rule in RULES if rule.holds(thing)), None)
    if rule is None:
        raise ConfigurationError(
            f"{type_of(thing)} cannot be shown; give {', '.join(r.what for r in RULES)}"
        )
    viewer = rule.show(thing)
    if obstacles:
        viewer.obstacles(obstacles)
    if compare is not None:
        viewer.compare(compare)
    if open is None and in_notebook():
        viewer.serve(port)
    elif open or open is None:
        viewer.open(port)
    return viewer


def in_notebook() -> bool:
    """Tell whether an IPython kernel runs this code."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return shell is not None and hasattr(shell, "kernel")


def _viewer(shown: Configuration | Session, motion: Motion | None = None) -> Viewer:
    """Show a configuration, or a session, and the motion that begins there."""
    with warnings.catch_warnings():  # meshcat imports what pyzmq deprecates
        warnings.simplefilter("ignore", DeprecationWarning)
        from spacearm.viewer.viewer import Viewer

    return Viewer(shown, motion)


def _home(arm: SpaceArm) -> Configuration:
    """Return the configuration with all joints at home."""
    return arm.at(arm.home)


def _arm(arm: SpaceArm) -> Viewer:
    """Show an arm at home, or bent if no home is stated and it is singular at zeros."""
    from spacearm.closure.holding import closed_by_itself  # slow to import, as the next
    from spacearm.viewer.session import opening_posture

    cfg = arm.at(opening_posture(arm))
    held = closed_by_itself(cfg)
    return _viewer(cfg) if held is None else _held(held)


def _motion(thing: Any) -> Viewer:
    """Play a motion."""
    motion = Motion.of(thing)
    return _viewer(motion.at(float(motion.t[0])), motion)


def _workspace(space: Any) -> Viewer:
    """Show the path dependent and path independent workspaces, cut open."""
    viewer = _viewer(_home(space.arm))
    viewer.shells(space)
    return viewer


def _nearest(found: Any) -> Viewer:
    """Show the posture of a singular set that is nearest to zeros in joint space."""
    return _viewer(found.arm.at(found.nearest(_home(found.arm).q).q))


def _attitudes(found: Any) -> Viewer:
    """Play the motion from the best attitude, with all feasible ones around the spacecraft."""
    viewer = _motion(found.motion())
    viewer.attitudes(found)
    return viewer


def _catch(found: Any) -> Viewer:
    """Play the flight of a catch, with the target."""
    from spacearm.motion.simulation import COARSE  # slow to import

    viewer = _motion(found.fly(integration=COARSE))
    viewer.target(found)
    return viewer


def _held(found: Any) -> Viewer:
    """Show the arms with the target that they hold, which is dragged, the grasps kept."""
    from spacearm.closure.holding import hold  # slow to import, as the next
    from spacearm.viewer.session import HeldSession

    cfg, pose = found.configuration, found.target.pose if found.target else pin.SE3.Identity()
    grasps = {tip: pose.actInv(at) for tip, at in zip(cfg.arm.tips, cfg.tips, strict=True)}
    held = hold(cfg, found.target, grasps, limits=not cfg.outside_limits)
    return _viewer(HeldSession(held))


def _region(region: Any) -> Viewer:
    """Show the first singular configuration of a region."""
    if not region.singular:
        raise ConfigurationError(
            f"the region is {region.kind} and has no singular configuration to show; view the arm"
        )
    return _viewer(region.singular[0])


class _Rule(NamedTuple):
    """How one kind of thing is shown.

    Attributes:
        what: The kind, for the message that lists what can be shown.
        holds: Whether a thing is of that kind.
        show: Makes its viewer.
    """

    what: str
    holds: Callable[[Any], bool]
    show: Callable[[Any], Viewer]


def _a(kind: type) -> Callable[[Any], bool]:
    return lambda thing: isinstance(thing, kind)


def _has(*names: str) -> Callable[[Any], bool]:
    return lambda thing: all(hasattr(thing, name) for name in names)


#: The first rule that holds for a thing shows it.
RULES = (
    _Rule("a SpaceArm", _a(SpaceArm), _arm),
    _Rule("a Configuration", _a(Configuration), _viewer),
    _Rule("a motion (with arm, t, q and base)", _has("arm", "t", "q", "base"), _motion),
    _Rule("a Workspace", _has("arm", "pdw", "reachable"), _workspace),
    _Rule("a singular set", _has("arm", "nearest"), _nearest),
    _Rule("feasible attitudes", _has("arm", "motion", "start"), _attitudes),
    _Rule("a Catch", _has("arm", "target", "fly"), _catch),
    _Rule("a Held or its report", _has("configuration", "target"), _held),
    _Rule("a Region", _has("singular", "kind"), _region),
    _Rule(
        "a result with a configuration",
        _has("configuration"),
        lambda result: _viewer(result.configuration),
    ),
)
