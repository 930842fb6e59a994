"""The models: every one is what its source says."""

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

import spacearm as sa

NAMES = [info.name for info in sa.catalogue()]


def test_catalogue_lists_the_models_of_the_package():
    assert NAMES == [
        "planar2", "planar3", "mda6", "ets7", "chaser7", "tecsas", "ssrms",
        "servicer_ur5", "servicer_panda", "cubesat_xarm", "dual_ur5", "vispa_cubesat",
    ]  # fmt: skip
    assert [a.name for a in sa.arms()] == ["vispa", "ur5", "ur10", "panda", "kinova", "xarm7", "z1"]


@pytest.mark.parametrize("info", sa.catalogue(), ids=NAMES)
def test_entries_are_true(info):
    arm = sa.load(info.name)
    assert (arm.n, arm.tip, arm.task.names) == (info.n, info.tip, info.task)
    assert len(info.summary) > 10
    assert len(info.source) > 10
    assert np.isfinite(arm.lower).all()
    assert np.isfinite(arm.upper).all()
    if info.recipe is None:
        robot = etree.parse(info.path).getroot()
        assert robot.getprevious() is not None, "names its source in a comment at its head"
    for name, part in arm.tree.links.items():
        assert part is None or part.mass == 0.0 or name in arm.tree.visuals, name


@pytest.mark.parametrize(
    ("name", "masses"),
    [
        ("planar2", [40, 4, 3]),
        ("planar3", [64.859, 2.9130, 2.6460, 1.6990]),
        ("mda6", [786, 0.36, 9.20, 9.20, 0.36, 0.36, 1.78]),
        ("ets7", [2552, 35, 22.7, 21.4, 16.8, 26.2, 18.1]),
        ("chaser7", [1579.20, 10, 17, 10, 16, 10, 10, 9]),
        ("tecsas", [140, 1.06488, 1.78201, 1.78201, 1.76068, 1.05615, 1.59936, 0.221118]),
        ("ssrms", [243.66, 105.98, 105.98, 314.88, 279.2, 105.98, 105.98, 243.66]),
        ("vispa_cubesat", [12.627, 2.328, 3.995, 2.328, 3.157, 2.695, 0.924]),
        ("cubesat_xarm", [12.88556, 2.382, 1.869, 1.6383, 1.7269, 1.3203, 1.325, 0.17]),
        ("dual_ur5", [208.0, *(2 * [3.7, 8.393, 2.275, 1.219, 1.219, 0.1879])]),
    ],
)
def test_masses(name, masses):
    model = sa.load(name, joints="all").model
    assert [body.mass for body in list(model.inertias)[1:]] == pytest.approx(masses)


def test_planar2_is_table_1():
    inertias = list(sa.load("planar2").model.inertias)[1:]
    assert [body.inertia[2, 2] for body in inertias] == [6.667, 0.333, 0.250]
    assert np.allclose(sa.load("planar2").at([0, 0]).tip.translation, [2.5, 0, 0])


def test_planar3_stretches_along_x():
    tip = sa.load("planar3").at([0, 0, 0]).tip.translation
    assert np.allclose(tip, [0.3696 + 0.4488 + 0.4499 + 0.3545, 0.001279, 0])


def test_mda6_is_its_denavit_hartenberg_table():
    rows = [
        (0.10, np.pi / 2, 0.06, 0), (2.61, 0, 0.10, 0), (2.62, 0, 0.10, 0),
        (0.10, -np.pi / 2, 0.10, 0), (0.10, np.pi / 2, 0.14, np.pi / 2), (0, 0, 0.50, 0),
    ]  # fmt: skip
    q = np.radians([10, 60, -100, -50, 20, 30])
    T = np.eye(4)
    T[2, 3] = 1.3
    for (a, alpha, d, offset), angle in zip(rows, q, strict=True):
        c, s, ca, sa_ = *(f(angle + offset) for f in (np.cos, np.sin)), np.cos(alpha), np.sin(alpha)
        T = T @ [
            [c, -s * ca, s * sa_, a * c],
            [s, c * ca, -c * sa_, a * s],
            [0, sa_, ca, d],
            [0, 0, 0, 1],
        ]
    assert sa.load("mda6").at(q).tip.isApprox(pin.SE3(T), 1e-12)


def test_chaser7_links_follow_their_source():
    cfg = sa.load("chaser7").at(np.zeros(7))
    origins = [(0, 0.084, 0.256), (0, -1.774, 0.084), (0, 0.084, 0.126), (0, -1.604, 0.084),
               (0, -0.084, 0.126), (0, 0.126, 0.084), (0, 0, 0.294)]  # fmt: skip
    turns = [(-1, 0, 0), (1, 2, 0), (-1, 0, 0), (1, 2, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 0)]
    pose = pin.SE3(pin.rpy.rpyToMatrix(np.pi, -np.pi / 2, 0), np.array([1.5, 0, 0]))
    for xyz, turn in zip(origins, turns, strict=True):
        pose = pose * pin.SE3(pin.rpy.rpyToMatrix(np.pi / 2 * np.array(turn)), np.array(xyz))
    assert cfg.tip.isApprox(pose, 1e-12)


def test_vispa_links_follow_their_source():
    rows = [
        ((0, 0, 0.18), (0, 0, 0)), ((0, 0, 0), (1, -1, 0)), ((0.8, 0, 0), (0, 0, -1)),
        ((0, 0.65, 0), (-1, 0, 0)), ((0, 0, 0), (1, 0, 0)), ((0, 0.325, 0), (-1, 0, 0)),
    ]  # fmt: skip
    q = np.linspace(-1.0, 1.0, 6)
    pose = pin.SE3(np.eye(3), np.array([0, 0, 0.15]))
    for (xyz, turn), angle in zip(rows, q, strict=True):
        placed = pin.SE3(pin.rpy.rpyToMatrix(np.pi / 2 * np.array(turn)), np.array(xyz))
        pose = pose * placed * pin.SE3(pin.utils.rotate("z", angle), np.zeros(3))
    assert sa.load("vispa_cubesat").at(q).tip.isApprox(pose, 1e-12)


def test_tecsas_is_the_table_of_spacedyn():
    """Its frames are at CMs and turn by roll, pitch, yaw about axes that turn along."""

    def turned(roll, pitch, yaw):
        angles = zip("xyz", np.radians([roll, pitch, yaw]), strict=True)
        x, y, z = (pin.utils.rotate(axis, angle) for axis, angle in angles)
        return x @ y @ z

    rpy = [(90, 0, 0), (90, 0, 0), (90, 0, 180), (180, 0, 0), (0, -90, 180), (0, 90, 180),
           (0, -90, 180)]  # fmt: skip
    to_cm = [(0, 0.0418, -0.063), (0.2742, 0.0418, -0.063), (0, -0.27, -0.0005),
             (0.2125, 0, -0.0423), (-0.0418, 0, -0.063), (0.0655, 0, -0.0422),
             (0, 0, 0)]  # fmt: skip
    q, arm = np.linspace(-1.2, 1.5, 7), sa.load("tecsas")
    R, joint, cms = np.eye(3), np.array([-0.275, 0.13, 0.06]), [np.zeros(3)]
    for turn, c, angle in zip(rpy, np.array(to_cm), q, strict=True):
        R = R @ turned(*turn) @ pin.utils.rotate("z", angle)
        cms.append(joint + R @ c)
        joint = cms[-1] + R @ c  # from the CM to the next joint it is as far again
    tip = pin.SE3(R @ turned(-90, 0, 90), cms[-1] + R @ np.array([0, 0, -0.15]))
    cfg = arm.at(q)
    assert cfg.tip.isApprox(tip, 1e-12)
    masses = [body.mass for body in list(arm.model.inertias)[1:]]
    np.testing.assert_allclose(cfg.com, np.average(cms, axis=0, weights=masses), atol=1e-14)


def test_ssrms_is_as_long_as_published():
    """Outstretched, and from joint to joint."""
    arm = sa.load("ssrms")
    at = arm.at(np.zeros(7)).tip.translation
    np.testing.assert_allclose(at, [2 * 1.3589 + 2 * 7.11, -2 * 0.5692 - 0.475, 0.0], atol=1e-12)
    places = [np.array(pin.SE3(p).translation) for p in list(arm.model.jointPlacements)[3:]]
    np.testing.assert_allclose(places, [
        [0, 0, 0.7026], [0, -0.5692, 0], [7.11, -0.475, 0], [7.11, 0, 0], [0, -0.5692, 0],
        [0, 0, -0.7026],
    ], atol=1e-12)  # fmt: skip
