"""View: configurations and motions in a browser, in notebooks, in files and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.model.arm import SpaceArm
from spacearm.motion.motion import Motion, Playable
from spacearm.viewer.notebook import in_notebook
from spacearm.workspaces.path_dependent import Workspace

if TYPE_CHECKING:
    from spacearm.viewer.viewer import Viewer


def view(
    thing: SpaceArm | Playable | Workspace,
    q: npt.ArrayLike | None = None,
    *,
    base: pin.SE3 | None = None,
    port: int | None = None,
    open: bool | None = None,  # noqa: A002 - the word for it
) -> Viewer:
    """Shows an arm, with sliders, or plays a motion, or shows the shells of a workspace.

    In a script or a terminal the page opens in the browser, served on 127.0.0.1 only, until
    `Viewer.close` or the end of the program. In a notebook, as the last line of a cell, the scene
    stands in the notebook and stays there when it is opened elsewhere.

    Args:
        thing: An arm, an object with `arm`, `t`, `q` and `base` (see `Motion`), or a workspace,
            whose path dependent shells are drawn about the system CM.
        q: (n,) joint positions to start from; zeros (or the nearest limits) if None.
        base: Pose of the spacecraft; the identity if None.
        port: Port of the page; the first free one from 7400 on if None.
        open: Whether to serve the page and open the browser; if None, unless in a notebook.

    Returns:
        A `Viewer`: `.url`, `.show`, `.shells`, `.save`, `.png`, `.close`.

    Raises:
        ConfigurationError: q, base or the motion has the wrong shape or is not finite.
        SpaceArmError: The port is in use.
    """
    from spacearm.viewer.viewer import Viewer

    if isinstance(thing, Workspace):
        viewer = view(thing.arm, q, base=base, open=False)
        viewer.shells([R for R in np.unique(thing.pdw) if R > 0.0] or [thing.reachable[0, 1]])
    elif isinstance(thing, SpaceArm):
        start = np.clip(0.0, thing.lower, thing.upper) if q is None else q
        viewer = Viewer(thing.at(start, base=base))
    else:
        motion = Motion.of(thing)
        viewer = Viewer(motion.at(float(motion.t[0])), motion)
    if open or (open is None and not in_notebook()):
        viewer.open(port)
    return viewer
