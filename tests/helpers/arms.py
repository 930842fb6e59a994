"""Robots for the tests: URDF text by hand, and random arms for hypothesis."""

from __future__ import annotations

import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from hypothesis import strategies as st

import spacearm as sa

LIMIT = '<limit lower="-3" upper="3" effort="10" velocity="1"/>'


def numbers(values) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


def link(name="link", mass=1.0, com=(0, 0, 0), inertia=None, inside="", rpy=(0, 0, 0)) -> str:
    I = np.eye(3) if inertia is None else np.asarray(inertia)
    entries = " ".join(
        f'i{"xyz"[i]}{"xyz"[j]}="{float(I[i, j])!r}"' for i in range(3) for j in range(i, 3)
    )
    return (
        f'<link name="{name}"><inertial><origin xyz="{numbers(com)}" rpy="{numbers(rpy)}"/>'
        f'<mass value="{mass}"/><inertia {entries}/></inertial>{inside}</link>'
    )


def frame(name) -> str:
    return f'<link name="{name}"/>'


def joint(
    name,
    parent,
    child,
    kind="revolute",
    xyz=(0.5, 0, 0),
    rpy=(0, 0, 0),
    axis=(0, 0, 1),
    inside=LIMIT,
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{numbers(xyz)}" rpy="{numbers(rpy)}"/><axis xyz="{numbers(axis)}"/>'
        f"{inside}</joint>"
    )


def robot(*elements) -> str:
    return f'<?xml version="1.0"?>\n<robot name="r">\n{chr(10).join(elements)}\n</robot>\n'


def two_links(**joint_options) -> tuple[str, ...]:
    return (link("bus", 50.0), link("arm"), joint("elbow", "bus", "arm", **joint_options))


def load_text(text: str, **options) -> sa.SpaceArm:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(text, encoding="utf-8")
        return sa.load(path, **options)


def random_inertia(rng, mass) -> np.ndarray:
    """About the CM of a random cloud of points: always possible for a rigid body."""
    points = rng.normal(size=(5, 3)) * rng.uniform(0.05, 0.6)
    points -= points.mean(axis=0)
    return mass / 5 * sum(p @ p * np.eye(3) - np.outer(p, p) for p in points)


def random_link(rng, name, mass=None) -> str:
    mass = 10 ** rng.uniform(-0.5, 1.5) if mass is None else mass
    return link(name, mass, rng.normal(size=3) * 0.4, random_inertia(rng, mass))


def random_joint(rng, name, parent, child, kinds=("revolute",), inside=LIMIT) -> str:
    return joint(
        name,
        parent,
        child,
        kind=rng.choice(kinds),
        xyz=rng.normal(size=3) * 0.6,
        rpy=rng.uniform(-np.pi, np.pi, 3),
        axis=rng.normal(size=3),
        inside=inside,
    )


def chosen(seed: int) -> np.random.Generator:
    """Return the generator of a chosen example, or that the package makes of a seed: none moves."""
    return np.random.Generator(np.random.PCG64(seed))


def random_chain(seed: int | np.random.Generator, n: int, kinds=("revolute", "continuous")) -> str:
    rng = np.random.default_rng(seed)
    names = ["bus", *(f"link_{i}" for i in range(1, n + 1))]
    elements = [random_link(rng, "bus", 10 ** rng.uniform(1, 3))]
    elements += [random_link(rng, name) for name in names[1:]]
    elements += [
        random_joint(rng, f"joint_{i}", names[i - 1], names[i], kinds) for i in range(1, n + 1)
    ]
    elements.append(frame("tip"))
    elements.append(joint("tip_joint", names[-1], "tip", "fixed", rng.normal(size=3) * 0.5))
    return robot(*elements)


def random_tree(seed: int | np.random.Generator, n: int) -> str:
    """Any movable joints, any branching, a mimic joint now and then; the tip is a random link."""
    rng = np.random.default_rng(seed)
    kinds = ("revolute", "continuous", "prismatic")
    elements = [random_link(rng, "link_0", 10 ** rng.uniform(1, 3))]
    for i in range(1, n + 1):
        follows = i > 1 and rng.random() < 0.2
        gain, offset = rng.normal(), np.clip(rng.normal(), -2.0, 2.0)  # the limits leave it room
        mimic = f'<mimic joint="joint_1" multiplier="{gain}" offset="{offset}"/>'
        elements.append(random_link(rng, f"link_{i}"))
        parent = f"link_{rng.integers(0, i)}"
        inside = LIMIT + (mimic if follows else "")
        elements.append(random_joint(rng, f"joint_{i}", parent, f"link_{i}", kinds, inside))
    return robot(*elements)


def scaled(text: str, length: float = 1.0, mass: float = 1.0) -> str:
    """The same robot with all lengths and all masses times a factor."""
    root = ElementTree.fromstring(text)

    def times(elements, names, factor):
        for element in elements:
            for name in names:
                if name in element.attrib:
                    element.set(
                        name, numbers([factor * float(x) for x in element.get(name).split()])
                    )

    times(root.iter("origin"), ["xyz"], length)
    times(root.iter("mass"), ["value"], mass)
    times(root.iter("inertia"), [f"i{a}{b}" for a in "xyz" for b in "xyz"], mass * length**2)
    slides = [joint for joint in root.iter("joint") if joint.get("type") == "prismatic"]
    times([limit for joint in slides for limit in joint.iter("limit")], ["lower", "upper"], length)
    return ElementTree.tostring(root, encoding="unicode")


def random_base(rng) -> pin.SE3:
    quaternion = rng.normal(size=4)
    return pin.SE3(pin.Quaternion(quaternion / np.linalg.norm(quaternion)), rng.normal(size=3))


seeds = st.integers(0, 2**32 - 1)


two_to_nine = st.integers(2, 9)
one_to_eight = st.integers(1, 8)


@st.composite
def chains(draw, joints=two_to_nine) -> sa.Configuration:
    """A random spatial chain in a random posture at a random spacecraft pose."""
    seed = draw(seeds)
    arm = load_text(random_chain(seed, draw(joints)), tip="tip")
    return random_configuration(arm, seed)


@st.composite
def trees(draw, joints=one_to_eight) -> sa.Configuration:
    """A random tree in a random posture at a random spacecraft pose."""
    seed, n = draw(seeds), draw(joints)
    tip = f"link_{draw(st.integers(1, n))}"
    arm = load_text(random_tree(seed, n), tip=tip, task=sa.Task("pose", length=1.0), joints="all")
    return random_configuration(arm, seed)


def random_configuration(arm: sa.SpaceArm, seed: int) -> sa.Configuration:
    rng = np.random.default_rng(seed + 1)
    return arm.at(rng.uniform(-np.pi, np.pi, arm.n), base=random_base(rng))


def moved(cfg: sa.Configuration, dq, v_b, h: float) -> sa.Configuration:
    """The configuration after time h with joint rates dq and spacecraft twist v_b."""
    turned = pin.exp3(h * v_b[3:]) @ cfg.base.rotation
    shifted = cfg.base.translation + h * v_b[:3]
    return cfg.arm.at(cfg.q + h * dq, base=pin.SE3(turned, shifted))


def same_accelerations(cfg: sa.Configuration, found, known, tau, mode="free-floating") -> None:
    """Compare joint accelerations (n,) by H* ddq, to 1e-12 of the torques that are added in it.

    The accelerations themselves differ by that times the condition number of H*.
    """
    H = sa.generalized_inertia(cfg, mode=mode)
    size = np.abs(H) @ np.abs(known) + np.abs(tau) + np.abs(tau - H @ known)
    np.testing.assert_allclose(H @ (found - known), 0.0, atol=1e-12 * size.max())


def planar_pair(tip=("left", "right"), joints="tip") -> sa.SpaceArm:
    """Two planar arms of two links on one spacecraft, without shapes."""
    return load_text(planar_pair_text(), tip=tip, joints=joints)


def planar_pair_text() -> str:
    """The robot of `planar_pair`."""
    parts = [link("bus", 40.0, inertia=np.diag([6.0, 6.0, 6.667]))]
    for side, x in (("left", -0.5), ("right", 0.5)):
        I = np.diag([0.01, 0.3, 0.3])
        parts += [link(f"{side}_{i}", 4.0, (0.5, 0, 0), I) for i in (1, 2)]
        parts += [
            joint(f"{side}_j1", "bus", f"{side}_1", xyz=(x, 0, 0)),
            joint(f"{side}_j2", f"{side}_1", f"{side}_2", xyz=(1, 0, 0)),
            f'<link name="{side}"/>',
            joint(f"{side}_t", f"{side}_2", side, "fixed", xyz=(1, 0, 0)),
        ]
    return robot(*parts)


def spherical(task: str = "pose") -> sa.SpaceArm:
    """Seven joints with spherical shoulder and wrist, as many laboratory arms have; 100 kg bus."""
    names = ["bus", *(f"link_{i}" for i in range(1, 8))]
    z, y = (0, 0, 1), (0, 1, 0)
    heights = (0.5, 0.36, 0.0, 0.42, 0.0, 0.4, 0.0)
    chain = [link("bus", 100.0, (0, 0, 0), 17.0 * np.eye(3))]
    chain += [link(name, 2.0, (0, 0, 0.08), 0.01 * np.eye(3)) for name in names[1:]]
    for i, (height, axis) in enumerate(zip(heights, (z, y, z, y, z, y, z), strict=True)):
        at = {"xyz": (0, 0, height), "axis": axis}
        chain.append(joint(f"joint_{i + 1}", names[i], names[i + 1], "continuous", **at))
    chain += [frame("tip"), joint("tip_joint", "link_7", "tip", "fixed", (0, 0, 0.126))]
    return load_text(robot(*chain), tip="tip", task=task)


def with_wheels(text, axes, torque=0.5, rate=300.0, mark="<wheel/>"):
    """A robot with wheels of 0.01 kg m^2 on its spacecraft, or the same as joints."""
    root = sa.load(text).tree.root if isinstance(text, str) and "<" not in text else "bus"
    text = sa.load(text).path.read_text() if "<" not in text else text
    inside = f'<limit effort="{torque}" velocity="{rate}"/>{mark}'
    parts = [
        link(f"rotor_{i}", 2.0, inertia=0.01 * np.eye(3))
        + joint(f"wheel_{i}", root, f"rotor_{i}", "continuous", (0.1, 0, 0), axis=a, inside=inside)
        for i, a in enumerate(np.atleast_2d(axes))
    ]
    return text.replace("</robot>", "\n".join(parts) + "</robot>")
