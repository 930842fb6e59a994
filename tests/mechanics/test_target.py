"""Targets: rotation against DOP853 and conservation laws, drift in orbit against the tide."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import spacearm as sa
from spacearm.collisions.obstacles import obstacles_of
from spacearm.mechanics.free_rotation import FreeRotation, elliptic
from spacearm.mechanics.target import drift

HOUR = 3600.0
BODY = np.array([10.0, 20.0, 25.0])


def integrated(inertia, attitude, w, t):
    """Attitude and angular velocity (inertial axes) by Euler's equations and DOP853."""

    def rates(_, y):
        w, v, s = y[:3], y[3:6], y[6]
        dq = 0.5 * np.concatenate((s * w + np.cross(v, w), [-v @ w]))
        return np.concatenate((np.linalg.solve(inertia, -np.cross(w, inertia @ w)), dq))

    start = np.concatenate((attitude.T @ w, Rotation.from_matrix(attitude).as_quat()))
    end = solve_ivp(rates, (0.0, t), start, method="DOP853", rtol=3e-14, atol=1e-15).y[:, -1]
    R = Rotation.from_quat(end[3:]).as_matrix()
    return R, R @ end[:3]


def angle(A, B):
    """Angle between two attitudes [rad]."""
    return np.linalg.norm(Rotation.from_matrix(A.T @ B).as_rotvec())


def turned(moments, seed):
    """Inertia with these principal moments about random axes, those axes, a random attitude."""
    axes, attitude = Rotation.random(2, random_state=seed).as_matrix()
    inertia = axes @ np.diag(moments) @ axes.T
    return (inertia + inertia.T) / 2.0, axes, attitude


@pytest.mark.parametrize(
    ("moments", "w"),
    [
        (BODY, [0.03, 0.05, 0.02]),
        (BODY, [0.02, 0.01, 0.06]),
        (BODY, [0.0, 0.0, 0.05]),  # pure spins
        (BODY, [0.05, 0.0, 0.0]),
        (BODY, [1e-9, 0.0, 0.05]),  # nearly
        (BODY, [0.05, 1e-7, 0.0]),
        ([10.0, 20.0, 20.0], [0.03, 0.02, 0.03]),  # bodies with an axis of symmetry
        ([10.0, 20.0, 20.0], [0.0, 0.05, 0.0]),
        ([20.0, 20.0, 30.0], [0.03, 0.02, 0.03]),
        ([20.0, 20.0, 30.0], [0.0, 0.05, 1e-9]),
        ([10.0, 20.0, 20.0 * (1 + 1e-12)], [1e-9, 0.05, 0.02]),  # nearly
        ([20.0, 20.0 * (1 + 1e-9), 30.0], [0.0, 0.05, 1e-6]),
        ([20.0, 20.0, 20.0], [0.03, 0.02, 0.03]),  # balls
        ([20.0, 20.0 + 1e-13, 20.0 + 3e-13], [0.03, 0.02, 0.03]),
    ],
)
def test_tumbling_is_that_of_the_integrated_equations_of_euler(moments, w):
    """Agreement to 1e-11 rad, after an hour too: half of it is the integration's own error."""
    t = HOUR if w == [0.03, 0.05, 0.02] else HOUR / 6
    inertia, axes, attitude = turned(np.array(moments), 5)
    start = attitude @ axes @ w
    R, rate = FreeRotation(inertia, attitude, start).at(t)
    R_i, rate_i = integrated(inertia, attitude, start, t)
    assert angle(R, R_i) < 1e-11
    np.testing.assert_allclose(rate, rate_i, rtol=0, atol=1e-12)


@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 1e-6, 1e-3])
def test_motions_near_the_spin_about_the_middle_axis(off):
    """As long as the departure, which grows as exp(lambda t), has not spread the rounding."""
    inertia, axes, attitude = turned(BODY, 3)
    w = attitude @ axes @ np.array([off, 0.05, off])
    R, rate = FreeRotation(inertia, attitude, w).at(60.0)
    R_i, rate_i = integrated(inertia, attitude, w, 60.0)
    assert angle(R, R_i) < 1e-12
    np.testing.assert_allclose(rate, rate_i, rtol=0, atol=1e-14)


@given(st.integers(0, 10**6))
def test_momentum_and_energy_stay_and_the_start_is_the_start(seed):
    """Momentum along inertial axes and energy at any time; the attitude at 0; R' = [w]x R."""
    rng = np.random.default_rng(seed)
    a, b, c = rng.uniform(0.01, 1.0, 3)
    inertia, _, attitude = turned(np.array([a + b, a + c, b + c]), seed)
    w = rng.normal(size=3) * 10 ** rng.uniform(-3, 0)
    free = FreeRotation(inertia, attitude, w)
    t = rng.uniform(-HOUR, HOUR, 20)
    R, rates = free.at(t)
    I = R @ inertia @ np.swapaxes(R, -1, -2)
    l = np.einsum("mij,mj->mi", I, rates)
    l0 = attitude @ inertia @ attitude.T @ w
    np.testing.assert_allclose(l, np.tile(l0, (20, 1)), rtol=0, atol=1e-12 * np.linalg.norm(l0))
    np.testing.assert_allclose((l * rates).sum(axis=1), l0 @ w, rtol=1e-12, atol=0)
    np.testing.assert_allclose(free.at(0.0)[0], attitude, rtol=0, atol=1e-13)
    assert (np.linalg.norm(rates, axis=1) <= free.fastest * (1 + 1e-12)).all()
    h = 1e-3 / np.linalg.norm(w)
    step = Rotation.from_matrix(free.at(t[0] + h)[0] @ free.at(t[0] - h)[0].T).as_rotvec()
    np.testing.assert_allclose(step / (2 * h), rates[0], rtol=0, atol=1e-5 * np.linalg.norm(w))


@pytest.mark.parametrize("m1", [1.0, 0.5, 1e-3, 1e-9, 1e-15, 1e-25, 1e-40])
def test_elliptic_functions_to_forty_digits(m1):
    """Against mpmath, where 1 - m is below what m can hold, too."""
    mp = pytest.importorskip("mpmath")
    with mp.workdps(60):
        m = 1 - mp.mpf(m1)
        for u in np.linspace(-1.0, 1.0, 9) * float(mp.ellipk(m)):
            wanted = [float(mp.ellipfun(name, u, m=m)) for name in ("sn", "cn", "dn")]
            np.testing.assert_allclose(elliptic(np.array(u), m1), wanted, rtol=0, atol=5e-15)


@given(st.integers(0, 10**6))
def test_drift_in_orbit_is_that_of_the_tide_in_inertial_axes(seed):
    """r'' = -n^2 (r - 3 u (u.r)), u the radial direction, which turns with the orbit."""
    rng = np.random.default_rng(seed)
    n, t = rng.uniform(1e-4, 2e-3), rng.uniform(10.0, 5000.0)
    r, v = rng.normal(size=3) * 5.0, rng.normal(size=3) * 0.01

    def rates(s, y):
        u = np.array([np.cos(n * s), np.sin(n * s), 0.0])
        return np.concatenate((y[3:], -(n**2) * (y[:3] - 3 * u * (u @ y[:3]))))

    end = solve_ivp(rates, (0, t), [*r, *v], method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    place, speed = drift(r, v, t, n)
    size = np.linalg.norm(end[:3])
    np.testing.assert_allclose(place, end[:3], rtol=0, atol=1e-10 * size)
    np.testing.assert_allclose(speed, end[3:], rtol=0, atol=1e-10 * n * size + 1e-13)


EARTH = 3.986004418e14  # gravitational parameter [m^3/s^2]


@given(st.integers(0, 10**6))
def test_in_orbit_the_distance_to_the_chaser_is_that_of_two_bodies_about_the_earth(seed):
    """Both are integrated about the centre of the Earth; Clohessy and Wiltshire to first order.

    The frame moves with the chaser's momentum on board, so that the chaser's CM is at com + p/M t.
    """
    rng = np.random.default_rng(seed)
    R = rng.uniform(6.6e6, 7.5e6)
    n, t = np.sqrt(EARTH / R**3), rng.uniform(60.0, 300.0)
    start = planar(rng)
    com, speed = start.com, start.momentum[:3] / start.arm.mass
    target = debris(orbit=n).replace(pose=sa.pose(com + rng.normal(size=3) * 5.0))
    place, v = target.cm

    def rates(_, y):
        pulls = [-EARTH * r / np.linalg.norm(r) ** 3 for r in (y[:3], y[6:9])]
        return np.concatenate((y[3:6], pulls[0], y[9:], pulls[1]))

    chaser = np.array([R, 0.0, 0.0, 0.0, n * R, 0.0])
    other = chaser + np.concatenate((place - com, v - speed))
    first = np.concatenate((chaser, other))
    end = solve_ivp(rates, (0.0, t), first, method="DOP853", rtol=1e-13, atol=1e-9).y[:, -1]
    near, at = end[6:9] - end[:3], target.relative_to(start).at(t)
    r = at.pose.act(target.com) - com - t * speed
    size = np.linalg.norm([place - com, near], axis=1).max()
    second = 10.0 * size**2 / R * (n * t) ** 2  # what Clohessy and Wiltshire leave out
    np.testing.assert_allclose(r, near, rtol=0, atol=second + 1e-7)
    still = place - com + t * (v - speed)
    assert np.linalg.norm(r - near) < 0.01 * np.linalg.norm(still - near)


def planar(rng) -> sa.Configuration:
    """A chaser up to hundreds of metres from the origin, with linear momentum on board."""
    arm = sa.load("planar2")
    there = sa.pose(rng.normal(size=3) * 100.0)
    return arm.at([0.5, 0.5], base=there, momentum=np.append(rng.normal(size=3) * 0.1, np.zeros(3)))


def test_relative_motion_in_orbit_does_not_depend_on_where_the_origin_is():
    """Both 50 m off radially, in free fall: about the origin the tide would move them 13.6 mm."""
    n, off = 0.0011, np.array([50.0, 0.0, 0.0])
    arm = sa.load("planar2")
    near, far = (arm.at([0.5, 0.5], base=sa.pose(place)) for place in (np.zeros(3), off))
    target = debris(orbit=n)
    moved = target.replace(pose=sa.pose(target.pose.translation + off, (0.3, 0, 1)))
    a, b = target.relative_to(near), moved.relative_to(far)
    for t in (0.0, 15.0, 300.0):
        assert np.allclose(
            b.at(t).pose.translation - far.com,
            a.at(t).pose.translation - near.com,
            rtol=0.0,
            atol=1e-12,
        )
    wrong = np.linalg.norm(moved.at(15.0).pose.translation - b.at(15.0).pose.translation)
    assert wrong == pytest.approx(n**2 * (50.0 + near.com[0]) * 15.0**2, rel=1e-2)
    np.testing.assert_array_equal(b.at(0.0).twist, moved.at(0.0).twist)


def test_the_chaser_of_a_target_is_kept_by_its_copies_and_known_to_its_obstacles():
    """The reference passes to replaced and scaled targets; an obstacle that begins later shares it.

    Linear momentum counts: the chaser's CM at the beginning is where the momentum has brought it.
    """
    start = planar(np.random.default_rng(3))
    drifted = start.centred(start.com + 30.0 * start.momentum[:3] / start.arm.mass)
    target = debris(orbit=0.0011)
    seen = target.relative_to(start)
    whole = seen.at(100.0).pose.translation
    assert np.linalg.norm(whole - target.at(100.0).pose.translation) > 1e-3
    same = [
        seen.replace(name="other"),
        seen.scaled(2.0, 2.0),
        target.relative_to(drifted, 30.0),
        obstacles_of(sa.Obstacle.of_target(target, begin=30.0), drifted)[0].target,
        obstacles_of(target, drifted, 30.0)[0].target,
    ]
    for one in same:
        np.testing.assert_allclose(one.at(100.0).pose.translation, whole, rtol=0, atol=1e-10)


def test_five_metres_of_radial_offset_give_three_centimetres_in_a_minute():
    """Theory, section 10: at rest in the axes that turn with a low orbit."""
    n = 0.00113
    r = np.array([5.0, 0.0, 0.0])
    place, _ = drift(r, np.cross([0.0, 0.0, n], r), 60.0, n)
    c, s = np.cos(n * 60.0), np.sin(n * 60.0)
    radial = c * place[0] + s * place[1] - 5.0
    assert radial == pytest.approx(1.5 * n**2 * 5.0 * 60.0**2, rel=1e-2)


def debris(**changes) -> sa.Target:
    """A box with its CM off its frame, tumbling, with a grapple frame."""
    values = {
        "twist": (0.0, 0.01, -0.005, 0.01, 0.02, 0.05),
        "grapples": {"ring": sa.pose((0, 0, -1), (0.1, 0.2, 0.3))},
    }
    bus = sa.Bus(90, size=(1, 1, 2), com=(0.1, 0.0, 0.2), name="debris")
    return sa.Target(bus, sa.pose((2.5, 0.4, 0), (0.3, 0, 1)), **(values | changes))


@pytest.mark.parametrize("orbit", [0.0, 0.0011])
@pytest.mark.parametrize("frame", [None, "ring"])
def test_twists_are_the_derivatives_of_poses(frame, orbit):
    """Central differences of frames, off the CM, in orbit too; the CM moves freely."""
    target, h = debris(orbit=orbit), 1e-3
    np.testing.assert_allclose(target.at(0.0).twist, target.twist, rtol=0, atol=1e-14)
    for t in (0.0, 70.0, 2000.0):
        before, now, after = (target.at(t + s, frame) for s in (-h, 0.0, h))
        v = (after.pose.translation - before.pose.translation) / (2 * h)
        w = pin.log3(after.pose.rotation @ before.pose.rotation.T) / (2 * h)
        np.testing.assert_allclose(now.twist, np.concatenate((v, w)), rtol=0, atol=1e-9)


@given(st.integers(0, 10**6))
def test_no_point_moves_farther_than_the_bound(seed):
    """`Target.moved` bounds the way of any point between two times."""
    rng = np.random.default_rng(seed)
    target = debris(orbit=rng.choice([0.0, 0.0011]), twist=rng.normal(size=6) * 0.1)
    target = target.relative_to(planar(rng))
    point = rng.normal(size=3)
    t0, t1 = np.sort(rng.uniform(0.0, 300.0, 2))
    way = np.linalg.norm(target.at(t1).pose.act(point) - target.at(t0).pose.act(point))
    assert way <= target.moved(float(np.linalg.norm(point)), t0, t1) * (1 + 1e-12)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (
            "debris.sdf",
            """<sdf version="1.9"><model name="debris"><link name="a"><inertial><mass>40</mass>
            <inertia><ixx>4</ixx><iyy>5</iyy><izz>6</izz></inertia></inertial></link><link name="b">
            <pose>1 0 0 0 0 0</pose><inertial><mass>10</mass><inertia><ixx>1</ixx><iyy>1</iyy>
            <izz>1</izz></inertia></inertial></link><joint name="f" type="fixed">
            <parent>a</parent><child>b</child></joint></model></sdf>""",
        ),
        (
            "debris.xml",
            """<mujoco><worldbody><body name="a"><freejoint/><inertial pos="0 0 0" mass="40"
            diaginertia="4 5 6"/><body name="b" pos="1 0 0"><inertial pos="0 0 0" mass="10"
            diaginertia="1 1 1"/></body></body></worldbody></mujoco>""",
        ),
    ],
)
def test_a_target_is_read_from_sdf_and_mjcf(tmp_path, name, text):
    """Two bodies fixed to each other are one, without a joint."""
    (tmp_path / name).write_text(text)
    target = sa.Target(tmp_path / name)
    assert target.mass == pytest.approx(50.0)
    np.testing.assert_allclose(target.com, [0.2, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(target.inertia, np.diag([5.0, 14.0, 15.0]), atol=1e-9)


def test_a_target_of_several_links_is_one_body_with_its_marks_as_grapples(tmp_path):
    """Masses add up about the common CM; a link without mass is a grapple frame."""
    file = tmp_path / "debris.urdf"
    file.write_text(
        """<robot name="debris">
        <link name="tank"><inertial><mass value="60"/><inertia ixx="9" iyy="9" izz="4" ixy="0"
          ixz="0" iyz="0"/></inertial><collision><geometry><cylinder radius="0.4" length="1.2"/>
          </geometry></collision></link>
        <link name="panel"><inertial><mass value="20"/><inertia ixx="1" iyy="1" izz="2" ixy="0"
          ixz="0" iyz="0"/></inertial><visual><geometry><box size="1 1 0.02"/></geometry></visual>
          </link>
        <link name="ring"/>
        <joint name="a" type="fixed"><parent link="tank"/><child link="panel"/>
          <origin xyz="1 0 0"/></joint>
        <joint name="b" type="fixed"><parent link="tank"/><child link="ring"/>
          <origin xyz="0 0 -0.6"/></joint></robot>"""
    )
    target = sa.Target(file, twist=(0, 0, 0, 0, 0, 0.1))
    assert target.name == "debris"
    assert target.mass == pytest.approx(80.0)
    np.testing.assert_allclose(target.com, [0.25, 0, 0], atol=1e-15)
    reduced = 60.0 * 20.0 / 80.0
    np.testing.assert_allclose(
        target.inertia, np.diag([10.0, 10.0 + reduced, 6.0 + reduced]), atol=1e-12
    )
    assert list(target.grapples) == ["ring"]
    assert [part.link for part in sa.Obstacle.of_target(target).parts] == ["tank", "panel"]
    ends = [np.ptp(part.reshape(-1, 3), axis=0) for part in target.drawn]
    np.testing.assert_allclose(ends[0], (0.8, 0.8, 1.2), rtol=0.01, atol=0.0)
    np.testing.assert_allclose(ends[1], (1.0, 1.0, 0.02), rtol=1e-9, atol=0.0)
    np.testing.assert_allclose(target.drawn[1].mean(axis=(0, 1)), (1.0, 0.0, 0.0), atol=1e-9)


def test_a_target_without_shapes_is_drawn_as_the_box_of_its_inertia():
    bus = sa.Bus(60.0, inertia=np.diag([5.0, 25.0, 25.0 + 1e-9]), com=(0.0, 0.0, 0.3))
    (box,) = sa.Target(bus).drawn  # edges a, b, c: I_xx = m (b^2 + c^2) / 12 and so on
    ends = np.sort(np.ptp(box.reshape(-1, 3), axis=0))
    np.testing.assert_allclose(ends, np.sqrt([0.5, 0.5, 4.5]), rtol=1e-6, atol=0.0)
    np.testing.assert_allclose(box.reshape(-1, 3).mean(axis=0)[2], 0.3, rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_a_motion_meets_a_target_on_its_way_and_not_one_far_off():
    """A check of collisions finds a tumbling target on the way, not one far off."""
    arm = sa.load("servicer_ur5")
    start = arm.at(np.array([0.0, -1.2, 1.2, 0.0, 0.5, 0.0]))
    motion = sa.simulate(start, sa.JointPD(start.q + 0.3, kp=60.0, kd=60.0), duration=20.0)
    path = motion.tip[:, :3]
    hit = debris(twist=(0, 0, 0, 0, 0, 0.05)).replace(pose=sa.pose(path[-1]))
    far = hit.replace(pose=sa.pose(path[-1] + [0.0, 0.0, 6.0]))
    assert sa.collision_check(motion, obstacles=hit).contact is not None
    assert sa.collision_check(motion, obstacles=far).contact is None


def test_an_obstacle_begins_where_the_target_is_then():
    """The obstacle of a motion that begins later is the target at that time, and moves on."""
    target = debris(orbit=0.0011)
    one, later = sa.Obstacle.of_target(target), sa.Obstacle.of_target(target, begin=30.0)
    for t in (0.0, 12.0):
        for a, b in zip(one.poses(30.0 + t), later.poses(t), strict=True):
            np.testing.assert_allclose(a.homogeneous, b.homogeneous, rtol=0, atol=1e-14)
    part = later.parts[0]
    assert later.motion.moved(part, 0.0, 5.0) == one.motion.moved(part, 30.0, 35.0)


@pytest.mark.parametrize(
    ("make", "names"),
    [
        (lambda: debris(orbit=-1.0), "orbit"),
        (lambda: debris(orbit="low"), "orbit"),
        (lambda: debris(twist=(1, 2, 3)), "twist"),
        (lambda: debris(up_axes=1), "up_axes is 1; give True or False"),
        (lambda: debris(grapples=["ring"]), "grapples"),
        (lambda: debris(grapples={"ring": 3.0}), "ring"),
        (lambda: debris().at(np.nan), "t is"),
        (lambda: debris().at(0.0, "rings"), "ring"),
        (lambda: sa.Target(3.0), "body"),
        (lambda: sa.Obstacle.of_target("debris"), "Target"),
    ],
)
def test_mistakes_are_named(make, names):
    """Each error names the argument."""
    with pytest.raises((sa.ConfigurationError, sa.ModelError), match=names):
        make()


def test_a_body_without_mass_is_told_what_it_lacks(tmp_path):
    (file := tmp_path / "frame.urdf").write_text('<robot name="frame"><link name="hull"/></robot>')
    with pytest.raises(sa.ModelError, match=r"'hull' has no mass; give it a mass and an inertia$"):
        sa.Target(file)


def test_a_body_with_joints_is_no_target():
    """The error names joints and the remedy."""
    with pytest.raises(sa.ModelError, match=r"joints that move.*Obstacle\.robot"):
        sa.Target(sa.load("planar2").path)


@pytest.mark.parametrize("twist", [(0.0,) * 6, (0.0, 0.0, 0.0, 0.0, 0.0, 0.05)])
def test_a_target_beside_the_way_is_held_off_by_plans(twist):
    arm = sa.load("planar2")
    debris = sa.Target(sa.Bus(90, size=(1, 1, 2)), sa.pose((3.0, 0.0, 0.0)), twist=twist)
    near = sa.Constraints(obstacles=[debris])
    plan = sa.plan(arm.at([0.3, 1.2]), sa.Joints([0.6, 1.5]), constraints=near)
    assert plan.apart
    assert sa.collision_check(plan, debris).distance.min() > 0.0
