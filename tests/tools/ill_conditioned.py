"""Arms that take digits away, and what is left of them, against 50-digit arithmetic.

python tests/tools/ill_conditioned.py        # the table of docs/validation.md
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import mpmath as mp
import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1]))
import pinocchio as pin
from helpers import arms, precise

import spacearm as sa

CATALOGUE = ("planar2", "planar3", "mda6", "ets7", "chaser7")


def chain(rng, masses, tilt=None) -> sa.SpaceArm:
    """A random chain; with `tilt` its axes are parallel up to about so much [rad]."""
    n = len(masses) - 1
    names = ["bus", *(f"link_{i}" for i in range(1, n + 1))]
    elements = [arms.random_link(rng, name, m) for name, m in zip(names, masses, strict=True)]
    for i in range(n):
        place = {"xyz": rng.normal(size=3) * 0.6, "axis": rng.normal(size=3)}
        if tilt is None:
            place["rpy"] = rng.uniform(-3, 3, 3)
        else:
            place["axis"] = np.array([0, 0, 1]) + tilt * place["axis"]
        elements.append(arms.joint(f"joint_{i + 1}", names[i], names[i + 1], **place))
    elements += [arms.frame("tip"), arms.joint("hand", names[-1], "tip", "fixed")]
    return arms.load_text(arms.robot(*elements), tip="tip", task="pose" if n > 5 else "position")


def light_and_heavy(rng):
    return chain(rng, 10 ** rng.uniform(-4.5, 4.5, rng.integers(4, 9)))


def heavy_spacecraft(rng):
    return chain(rng, [1e9, *rng.uniform(1, 10, rng.integers(3, 8))])


def heavy_payload(rng):
    """A point mass, up to 1e9 times the lightest body."""
    arm = sa.load(rng.choice(CATALOGUE))
    lightest = min(inertia.mass for inertia in arm.model.inertias[1:])
    return arm.replace(payload=lightest * 10 ** rng.uniform(3, 9))


def nearly_parallel_axes(rng):
    return chain(rng, 10 ** rng.uniform(0, 2, rng.integers(4, 9)), 10.0 ** -rng.integers(1, 13))


def parallel_axes(rng):
    """Exactly singular: position and pose of such an arm have directions it cannot move in."""
    return chain(rng, 10 ** rng.uniform(-4.5, 4.5, rng.integers(4, 9)), 0.0)


def from_the_catalogue(rng):
    return sa.load(rng.choice(CATALOGUE))


def trees(rng):
    """Sliding, turning and mimic joints; few of them lead to the tip, so that zeros are common."""
    text = arms.random_tree(int(rng.integers(1000)), 6)
    return arms.load_text(text, tip="link_6", task="position", joints="all")


def out_and_back(rng) -> str:
    """URDF of a chain with frames up to 1e9 m away, and back, in its bodies, joints and tip."""
    n, away = int(rng.integers(3, 6)), 10 ** rng.uniform(0, 9)
    elements = [arms.frame("tip"), *detour(rng, f"link_{n}", "tip", "fixed", away)]
    for i in range(n + 1):
        for name in (f"link_{i}", f"load_{i}"):
            mass = 10 ** rng.uniform(0, 2)
            placed = {"com": rng.normal(size=3), "rpy": rng.uniform(-3, 3, 3)}
            elements.append(arms.link(name, mass, inertia=arms.random_inertia(rng, mass), **placed))
        elements += detour(rng, f"link_{i}", f"load_{i}", "fixed", away)
    for i in range(n):
        elements += detour(rng, f"link_{i}", f"link_{i + 1}", "continuous", away)
    return arms.robot(*elements)


def detour(rng, parent, child, kind, away) -> list[str]:
    """A joint of ordinary length, half of them by way of a frame that is not."""
    xyz, way = rng.normal(size=3) * 0.6, []
    if rng.random() < 0.5:
        out, rpy, frame = rng.normal(size=3) * away, rng.uniform(-3, 3, 3), f"way_to_{child}"
        way = [arms.frame(frame), arms.joint(f"out_to_{child}", parent, frame, "fixed", out, rpy)]
        parent, xyz = frame, pin.rpy.rpyToMatrix(rpy).T @ (xyz - out)
    rpy, axis = rng.uniform(-3, 3, 3), rng.normal(size=3)
    return [*way, arms.joint(f"joint_{child}", parent, child, kind, xyz, rpy, axis)]


def far_frames(rng):
    return arms.load_text(out_and_back(rng), tip="tip", task="position")


def coaxial_rods(rng):
    """Rods that turn about the axis that all share, their CMs in one point."""
    n, thin = int(rng.integers(2, 6)), 10.0 ** -rng.uniform(3, 9)
    R = [pin.rpy.rpyToMatrix(rpy) for rpy in rng.uniform(-3, 3, (n + 1, 3))]  # links to rod axes
    elements = [arms.frame("tip"), arms.joint("hand", f"link_{n}", "tip", "fixed", np.zeros(3))]
    for i in range(n + 1):
        I = 10 ** rng.uniform(0, 2) * R[i].T @ np.diag([1.0, 1.0, thin]) @ R[i]
        elements.append(arms.link(f"link_{i}", 10 ** rng.uniform(0, 2), inertia=(I + I.T) / 2))
    for i in range(n):
        placed = {"rpy": pin.rpy.matrixToRpy(R[i].T @ R[i + 1]), "axis": R[i + 1].T[:, 2]}
        turns = arms.joint(f"joint_{i}", f"link_{i}", f"link_{i + 1}", xyz=np.zeros(3), **placed)
        elements.append(turns)
    return arms.load_text(arms.robot(*elements), tip="tip", task="orientation", check="accept")


FAMILIES = {
    "catalogue": from_the_catalogue,
    "random trees": trees,
    "masses from 1 to 1e9": light_and_heavy,
    "spacecraft 1e9 times as heavy": heavy_spacecraft,
    "point payload up to 1e9": heavy_payload,
    "axes parallel to 1e-1 .. 1e-12": nearly_parallel_axes,
    "parallel axes, exactly singular": parallel_axes,
    "fixed frames, 1 to 1e9 m away": far_frames,
    "coaxial rods, thin to 1e-9": coaxial_rods,
}


class Measured(NamedTuple):
    """sigma_min to 50 digits, largest error of a singular value, its bar, J*'s worst share."""

    sigma_min: float
    error: float
    bar: float
    share: float
    """Largest error of an entry of J* as a share of its bar."""


def measured(cfg: sa.Configuration, mode="free-floating", tree=None) -> Measured:
    """What double precision did to a configuration at the identity attitude."""
    J = precise.generalized_jacobian(cfg, mode, tree)
    sigma = precise.singular_values(cfg, J)
    bars = sa.error_bars(cfg, mode=mode)
    found = sa.generalized_jacobian(cfg, mode=mode)
    off = np.abs((J - mp.matrix(found.tolist())).tolist()).astype(float)
    assert not off[bars.jacobian == 0.0].any()
    with np.errstate(invalid="ignore"):
        share = float(np.nanmax(off / bars.jacobian, initial=0.0))
    pairs = zip(sigma, sa.singularity(cfg, mode=mode).sigma, strict=True)
    error = max(float(abs(exact - mp.mpf(float(ours)))) for exact, ours in pairs)
    return Measured(float(sigma[-1]), error, bars.sigma, share)


def samples(family, count):
    for seed in range(count):
        rng = np.random.default_rng(seed)
        arm = FAMILIES[family](rng)
        yield arm.at(rng.uniform(-3, 3, arm.n)), ("free-floating", "attitude-controlled")[seed % 2]


def main() -> None:
    print(f"{'':34}{'sigma_min':>20}{'largest':>10}{'largest':>10}{'error as share of bar':>30}")
    print(f"{'':34}{'least':>10}{'median':>10}{'error':>10}{'bar':>10}", end="")
    print(f"{'sigma':>10}{'median':>10}{'J*':>10}")
    for family in FAMILIES:
        sigma, error, bar, share = np.array([measured(*s) for s in samples(family, 100)]).T
        shares = error / bar
        row = (sigma.min(), np.median(sigma), error.max(), bar.max(), shares.max())
        row += (np.median(shares), share.max())
        print(f"{family:34}" + "".join(f"{value:10.1e}" for value in row))


if __name__ == "__main__":
    main()
