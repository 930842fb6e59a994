"""Planning: plans arrive when an independent integrator replays them, and failures say why."""

import json
import re

import numpy as np
import pinocchio as pin
import pytest
from helpers.commands import spacearm
from helpers.replay import replay

import spacearm as sa
from spacearm.planning.methods import METHODS
from spacearm.planning.optimiser import CurveFamily, CurveOptimiser, Sines, Target
from spacearm.planning.timing import largest_rates, rest_to_rest_times

E, B, C = np.radians([-57.936, 60.337]), np.array([1.5, 1.5]), np.array([1.0, 0.0])


def about_cm(arm, q, *rpy):
    """The spacecraft with this attitude, the system CM at the origin."""
    attitude = pin.SE3(pin.rpy.rpyToMatrix(np.array(rpy)), np.zeros(3))
    return arm.at(q, base=attitude).centred(np.zeros(3)).base


@pytest.fixture(scope="module")
def arm():
    return sa.load("planar2")


@pytest.fixture(scope="module")
def found(arm):
    return sa.plan(arm.at(E, base=about_cm(arm, E, 0, 0, np.radians(21))), B)


# --- the open problem -----------------------------------------------------------------------


@pytest.mark.slow
def test_the_open_problem_of_the_paper(arm, found):
    """Nine squares lead there too; the plan takes less than a third of their joint travel."""
    straight, curve = found.tried
    assert (straight.method, straight.arrived) == ("straight", False)
    assert "singular after 1.193 of 1.581 m" in straight.story
    assert (curve.method, curve.arrived) == ("joint space", True)
    np.testing.assert_allclose(replay(found)[0].tip.translation[:2], B, atol=1e-6)
    assert found.certificate.free
    assert found.distance.min() > found.clearance
    assert (np.abs(found.q) <= np.pi).all()
    corners = [C + 0.2 * np.array(p) for p in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    squares = sa.follow(
        arm.at(E, base=found[0].base), [C, *(9 * corners), corners[0], C, B], limits=False
    )
    assert squares.arrived
    assert found.length < np.abs(np.diff(squares.q, axis=0)).sum() / 3


def test_times_respect_the_velocity_limits(arm, found):
    rates = np.abs(np.diff(found.q, axis=0)) / np.diff(found.t)[:, None]
    limits = [arm.tree.joints[name].velocity for name in arm.joint_names]
    assert (rates.max(axis=0) <= np.array(limits) * (1.0 + 1e-9)).all()
    assert rates.max() > 0.9 * min(limits)


def test_stated_rates_are_kept(arm):
    """Half the rate takes twice the time, the path being the same; one joint may set the pace."""
    start, goal = arm.at([0.3, 1.2]), (0.9, 1.4)
    both, half = (sa.plan(start, goal, constraints=sa.Constraints(rates=r)) for r in (0.2, 0.1))
    np.testing.assert_array_equal(half.q, both.q)
    assert half.t[-1] == pytest.approx(2.0 * both.t[-1], rel=1e-12)
    slow = sa.plan(start, goal, constraints=sa.Constraints(rates=[0.2, 0.01]))
    rates = np.abs(np.diff(slow.q, axis=0)) / np.diff(slow.t)[:, None]
    assert 0.009 < rates[:, 1].max() <= 0.01 * (1.0 + 1e-9)


def test_the_joints_come_to_rest_at_corners(arm):
    corner = np.vstack(
        (np.linspace([0, 1.0], [0.5, 1.0], 30), np.linspace([0.5, 1.0], [0.5, 2.0], 60))
    )
    t = rest_to_rest_times(corner, largest_rates(arm))
    rates = np.diff(corner, axis=0) / np.diff(t)[:, None]
    assert np.abs(rates[28:30]).max() < 0.2 * np.abs(rates).max()
    assert np.abs(rates).max() <= (1.0 + 1e-9) * arm.tree.joints["joint_1"].velocity
    assert (np.diff(t) > 0.0).all()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_plan(arm, found):
    base = about_cm(arm, E, 0, 0, np.radians(21))
    np.testing.assert_array_equal(sa.plan(arm.at(E, base=base), B).q, found.q)
    loops = [
        sa.plan(arm.at(E, base=base), B, search=sa.Search(method="cycles", seed=s)).q
        for s in (5, 5, 6)
    ]
    np.testing.assert_array_equal(loops[0], loops[1])
    assert not np.array_equal(loops[0], loops[2])


def test_a_plan_is_a_motion_that_can_be_kept_and_drawn(found, tmp_path):
    assert sa.Motion.of(found).t[-1] == found.t[-1]
    found.save(tmp_path / "plan.npz")
    with np.load(tmp_path / "plan.npz") as file:
        np.testing.assert_array_equal(file["q"], found.q)
    assert len(sa.plot(found, target=B).axes) == 4
    assert "joint space" in repr(found)


@pytest.mark.slow
def test_cycles_where_one_curve_is_too_short():
    """Limits leave little room: only loops turn the spacecraft far enough."""
    arm = sa.load("planar2")
    q, far = np.radians([-134.0, -160.0]), np.array([1.2, 1.15])
    plan = sa.plan(
        arm.at(q, base=about_cm(arm, q, 0, 0, 2.0)),
        far,
        constraints=sa.Constraints(limits=False),
        search=sa.Search(method="cycles"),
    )
    np.testing.assert_allclose(replay(plan)[0].tip.translation[:2], far, atol=1e-6)
    assert plan.certificate.free


@pytest.mark.slow
def test_attitude_first_turns_to_where_the_line_is_free(arm):
    """From E the line to B is free after a turn under the tip; the story names the turns."""
    base = about_cm(arm, E, 0, 0, np.radians(21))
    plan = sa.plan(arm.at(E, base=base), B, search=sa.Search(method="attitude first", timeout=300))
    np.testing.assert_allclose(replay(plan)[0].tip.translation[:2], B, atol=1e-6)
    assert "the line is free after turns of" in plan.tried[0].story
    assert plan.certificate.free


# --- other arms and goals -------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [-90, 30])
def test_the_arm_as_attitude_actuator(arm, degrees):
    q = np.array([0.3, 1.2])
    plan = sa.plan(
        arm.at(q), sa.Joints(q), final_attitude=np.radians(degrees), search=sa.Search(timeout=300)
    )
    end = replay(plan)[0]
    np.testing.assert_allclose(plan.q[-1], q, atol=1e-8)
    turn = pin.log3(pin.exp3(np.radians([0, 0, degrees])).T @ end.base.rotation)
    assert np.linalg.norm(turn) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("axis", range(3))
def test_a_spatial_arm_turns_its_spacecraft(axis):
    arm = sa.load("chaser7")
    q = np.array([0.3, 0.8, -0.4, 1.1, 0.2, 0.9, 0.1])
    wanted = pin.exp3(np.radians(10) * np.eye(3)[axis])
    plan = sa.plan(arm.at(q), sa.Joints(q), final_attitude=wanted, search=sa.Search(timeout=300))
    np.testing.assert_allclose(plan.q[-1], q, atol=1e-8)
    np.testing.assert_allclose(replay(plan)[0].base.rotation, wanted, atol=1e-6)


@pytest.mark.slow
def test_a_pose_of_a_planar_arm_and_a_place_of_a_spatial_one():
    planar = sa.load("planar3")
    goal = planar.at(
        [-0.4, 1.3, 0.6], base=pin.SE3(pin.exp3(np.array([0, 0, 1.0])), np.zeros(3))
    ).tip
    plan = sa.plan(planar.at([0.5, 0.8, -0.9]), goal, constraints=sa.Constraints(limits=False))
    start_com = plan[0].com
    np.testing.assert_allclose(replay(plan)[0].tip.homogeneous, goal.homogeneous, atol=1e-6)
    np.testing.assert_allclose(plan[-1].com, start_com, atol=1e-9)
    spatial = sa.load("chaser7", task="position")
    q = np.array([0.3, 0.8, -0.4, 1.1, 0.2, 0.6, 0.1])
    place = spatial.at(q).tip.translation + np.array([0.3, -0.2, 0.1])
    plan = sa.plan(spatial.at(q), place)
    np.testing.assert_allclose(replay(plan)[0].tip.translation, place, atol=1e-6)
    assert plan.certificate.free  # by five of its 35 minors, which are too large together


# --- exactness of what the optimiser is told ------------------------------------------------


@pytest.mark.parametrize(("name", "loops"), [("planar2", 0), ("planar3", 3), ("mda6", 2)])
def test_gradients_of_the_cost_and_of_all_constraints_but_the_clearance(name, loops):
    arm, rng = sa.load(name), np.random.default_rng(1)
    q = np.full(arm.n, 0.7)
    goal = arm.at(q + 0.2).tip
    target = Target(goal, None, pin.exp3(np.array([0, 0, 0.2])), 0.01, arm.lower, arm.upper)
    optimiser = CurveOptimiser(arm.at(q), target, Sines(2), loops)
    optimiser._singularity_margins = lambda *_: (np.empty(0), np.empty((0, 3 * arm.n)))
    x = np.tile(q, 7)[: optimiser.size] + 0.2 * rng.normal(size=optimiser.size)

    def all_of(x):
        values = optimiser.values(x)
        return np.concatenate((values.end, values.margins, [optimiser.cost(x)[0]]))

    values = optimiser.values(x)
    exact = np.vstack((values.d_end, values.d_margins, optimiser.cost(x)[1]))
    steps = 1e-6 * np.eye(len(x))
    differences = np.array([(all_of(x + e) - all_of(x - e)) / 2e-6 for e in steps]).T
    np.testing.assert_allclose(exact, differences, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("name", ["planar2", "mda6", "chaser7"])
def test_slopes_of_the_clearance_near_the_singular_set(name):
    """The distance grows by what a motion goes along `away`, within some percent near the set."""
    arm, rng = sa.load(name), np.random.default_rng(0)
    for q in sa.singular_set(arm).sample(3, rng) + 2e-3 * rng.normal(size=(3, arm.n)):
        target = Target(None, q + 0.1, None, 0.01, arm.lower, arm.upper)
        optimiser = CurveOptimiser(arm.at(q), target, Sines(1))
        x = np.concatenate((q, np.zeros(arm.n)))  # stays where it is
        values = optimiser.values(x)
        last = rows_of_singularity(values, arm) - 1  # the end of the curve
        differences = [
            (optimiser.values(x + e).margins[last] - optimiser.values(x - e).margins[last]) / 2e-6
            for e in 1e-6 * np.eye(len(x))
        ]
        slopes = values.d_margins[last]
        assert np.linalg.norm(differences - slopes) < 0.2 * np.linalg.norm(slopes)


def rows_of_singularity(values, arm):
    """How many margins are those of the clearance: the others belong to finite limits."""
    limits = np.isfinite(arm.upper).sum() + np.isfinite(arm.lower).sum()
    return len(values.margins) - int(limits)


def test_the_holonomy_of_a_curve_converges_with_the_fourth_order():
    arm = sa.load("chaser7")
    rng = np.random.default_rng(0)
    q0 = rng.uniform(-1, 1, 7)
    p = np.vstack((rng.uniform(-1, 1, 7), 0.3 * rng.normal(size=(3, 7))))
    turns = {}
    for intervals in (8, 16, 32, 128):
        family = CurveFamily(arm, q0, Sines(3), intervals)
        turns[intervals] = family.samples(p, family.points(p)).turn
    errors = [np.abs(turns[m] - turns[128]).max() for m in (8, 16, 32)]
    assert errors[0] > 10 * errors[1] > 100 * errors[2]
    moved = arm.at(q0)
    for q in CurveFamily(arm, q0, Sines(3), 8).rows(p, 4000)[1:]:
        moved = sa.move(moved, q)
    np.testing.assert_allclose(turns[128], moved.base.rotation, atol=1e-6)


# --- failures -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("start", "goal", "options", "message"),
    [
        (E, (3.0, 0.0), {}, r"2\.28723 m"),
        ((0.0, 0.0), B, {}, "start is singular"),
        ((4.0, 1.0), B, {}, "limits=False"),
        (
            (0.3, 0.3),
            B,
            {"constraints": sa.Constraints(clearance=0.5)},
            "found .* from the start, and the clearance is 28.6",
        ),
        (E, B, {"search": sa.Search(method="straight")}, "singular after"),
        (E, sa.Joints(E + 0.1), {"search": sa.Search(method="straight")}, "joint space"),
        (E, B, {"search": sa.Search(method="joint space", timeout=1e-6)}, "time is up"),
    ],
)
def test_no_solution(arm, start, goal, options, message):
    with pytest.raises(sa.NoSolutionError, match=message) as caught:
        sa.plan(arm.at(start), goal, **options)
    np.testing.assert_array_equal(caught.value.best.q[0], start)


def test_out_of_reach_the_best_attempt_goes_until_it_is_stretched(arm):
    with pytest.raises(sa.NoSolutionError, match="comes no farther") as caught:
        sa.plan(arm.at([0.3, 1.2]), (3.0, 0.0))
    best, reach = caught.value.best, sa.workspace(arm).reachable.max()
    R = np.linalg.norm(best.tip[:, :2] - best[0].com[:2], axis=1)
    assert 0.99 * reach < R[-1] < reach + 1e-9
    assert best.sigma_min[-1] < 1e-9


@pytest.mark.slow
def test_limits_that_exclude_every_solution(tmp_path):
    """The tip could be there, but not with the joints between 0.9 and 1.1 rad."""
    text = sa.load("planar2").path.read_text()
    text = re.sub(r'lower="[^"]*" upper="[^"]*"', 'lower="0.9" upper="1.1"', text)
    (tmp_path / "stiff.urdf").write_text(text)
    arm = sa.load(tmp_path / "stiff.urdf")
    goal = arm.at([-0.5, 1.5]).centred(arm.at([1.0, 1.0]).com).tip.translation[:2]
    assert sa.plan(arm.at([1.0, 1.0]), goal, constraints=sa.Constraints(limits=False)).method
    with pytest.raises(sa.NoSolutionError, match="reaches its limit") as caught:
        sa.plan(arm.at([1.0, 1.0]), goal, search=sa.Search(timeout=8.0))
    best = caught.value.best
    assert ((best.q >= 0.9 - 1e-9) & (best.q <= 1.1 + 1e-9)).all()


def test_joints_beyond_a_singularity(arm):
    beyond = sa.Joints([0.3, -1.2])
    assert sa.singularity(arm.at(beyond.q)).determinant < 0.0
    with pytest.raises(sa.NoSolutionError, match="every way between them meets a singularity"):
        sa.plan(arm.at([0.3, 1.2]), beyond)


def test_the_best_attempt_comes_along(arm):
    base = about_cm(arm, E, 0, 0, np.radians(21))
    with pytest.raises(sa.NoSolutionError) as caught:
        sa.plan(arm.at(E, base=base), B, search=sa.Search(method="straight"))
    best = caught.value.best
    np.testing.assert_allclose(best.tip[-1, :2], (1.6227, 1.1319), atol=1e-3)
    assert not best.tried[0].arrived


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"final_attitude": (1.0, 2.0)}, "an angle"),
        ({"goal": (1.0, 2.0, 3.0)}, "2 finite numbers"),
        ({"goal": sa.Joints((1.0,))}, "goal has shape"),
        ({"constraints": sa.Constraints(rates=[1.0])}, "rates has shape|rates is"),
        ({"constraints": sa.Constraints(rates=-1.0)}, "rates is -1"),
    ],
)
def test_bad_input(arm, options, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.plan(arm.at(E), **({"goal": B} | options))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"timeout": 0.0}, "timeout is 0"),
        ({"timeout": "x"}, "timeout is 'x'"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_a_search_that_makes_no_sense(options, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.Search(**options)


def test_a_method_that_is_added_is_known_at_once(arm, monkeypatch):
    with pytest.raises(sa.ConfigurationError, match="unknown method 'magic'"):
        sa.plan(arm.at([0.3, 1.2]), (0.9, 1.4), search=sa.Search(method="magic"))
    monkeypatch.setitem(METHODS, "magic", METHODS["straight"])
    found = sa.plan(arm.at([0.3, 1.2]), (0.9, 1.4), search=sa.Search(method="magic"))
    assert found.method == "magic"


def test_constraints_that_make_no_sense():
    with pytest.raises(sa.ConfigurationError, match="clearance is -1"):
        sa.Constraints(clearance=-1.0)
    with pytest.raises(sa.ConfigurationError, match="leave out collisions=False"):
        sa.Constraints(obstacles=sa.Obstacle.box(0.1), collisions=False)


def test_what_is_asked_as_plain_data():
    asked = sa.Constraints(rates=np.array([0.1, 0.2]), obstacles=[sa.Obstacle.box(0.1)])
    told = json.loads(json.dumps(asked.to_dict()))
    assert told["rates"] == [0.1, 0.2]
    assert told["obstacles"][0]["kind"] == "box"
    assert sa.Search(progress=print).to_dict() == {"seed": 0, "timeout": 60.0, "method": "auto"}


@pytest.mark.parametrize(
    ("name", "goal", "options", "error", "message"),
    [
        ("planar2", sa.Joints([3.5, 1.2]), {}, sa.NoSolutionError, "goal of joint 'joint_1'"),
        ("planar2", sa.Joints([0.3, 0.25]), {"constraints": sa.Constraints(clearance=0.2)},
         sa.NoSolutionError, "from the goal, and the clearance is"),
        ("planar2", sa.Joints([0.4, 1.3]), {"final_attitude": pin.exp3(np.array([0.3, 0, 0]))},
         sa.NoSolutionError, "not a turn about z"),
        ("planar2", B, {"final_attitude": "x"}, sa.ConfigurationError, "final_attitude is 'x'"),
        ("planar3", pin.SE3(2 * np.eye(3), np.zeros(3)), {}, sa.ConfigurationError, "goal"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said_at_once(name, goal, options, error, message):
    arm = sa.load(name)
    with pytest.raises(error, match=message):
        sa.plan(arm.at([0.3, 1.2, 0.4][: arm.n]), goal, **options)


def test_fewer_joints_than_rows():
    with pytest.raises(sa.UnsupportedError, match="2 joints can move only 2 of"):
        sa.plan(sa.load("planar2", task="pose").at([0.3, 1.2]), sa.Joints([0.4, 1.3]))


def test_already_there(arm):
    cfg = arm.at([0.3, 1.2])
    for goal in (cfg.tip.translation[:2], sa.Joints(cfg.q)):
        plan = sa.plan(arm.at(cfg.q), goal)
        assert plan.length == 0.0
        assert plan.t.tolist() == [0.0]
        assert plan.certificate.free


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar2", "mda6"])
def test_the_spacecraft_turned_under_a_tip_that_stays(name):
    arm = sa.load(name)
    cfg = arm.at(np.linspace(0.3, 1.2, arm.n))
    turn = pin.exp3(np.array([0.0, 0.0, 0.1]))
    goal = cfg.tip if name == "mda6" else cfg.tip.translation[:2]
    plan = sa.plan(
        arm.at(cfg.q), goal, final_attitude=turn, constraints=sa.Constraints(collisions=False)
    )
    end = replay(plan)[0]
    np.testing.assert_allclose(end.base.rotation, turn, atol=1e-6)
    np.testing.assert_allclose(end.tip.translation, cfg.tip.translation, atol=1e-6)


@pytest.mark.slow
def test_a_goal_and_an_attitude_that_no_posture_has(arm):
    """The goal is where the arm reaches it stretched only, and then with one attitude."""
    cfg = arm.at([0.3, 0.02]).centred(arm.at([0.3, 1.2]).com)
    with pytest.raises(sa.NoSolutionError, match="searches found joint positions at the goal"):
        sa.plan(
            arm.at([0.3, 1.2]),
            cfg.tip.translation[:2],
            final_attitude=2.0,
            search=sa.Search(timeout=8.0),
        )


def test_one_row_of_the_tip():
    """What the task leaves open counts neither for reach nor for arriving."""
    arm = sa.load("planar2", task="x")
    plan = sa.plan(arm.at([0.8, 0.6]), [2.0])
    assert replay(plan)[0].tip.translation[0] == pytest.approx(2.0, abs=1e-6)


# --- the command line -----------------------------------------------------------------------


def run(*words, cwd):
    return spacearm("plan", *words, cwd=cwd)


@pytest.mark.slow
def test_command(tmp_path):
    words = ["planar2", "--deg", -57.936, 60.337, "--attitude", 0, 0, 21]
    done = run(
        *words, "--goal", 1.5, 1.5, "--with", "origin=cm", "--save", "plan.npz", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    for text in ("straight     fails", "joint space  arrives", "(1.5, 1.5, 0) m", "proven"):
        assert text in done.stdout
    assert sorted(p.name for p in tmp_path.iterdir()) == ["plan.npz", "planar2_plan.png"]
    done = run(
        *words,
        "--goal",
        1.5,
        1.5,
        "--with",
        "origin=cm",
        "--json",
        "--with",
        "search.method=joint space",
        cwd=tmp_path,
    )
    assert json.loads(done.stdout)["method"] == "joint space"
    done = run(*words, "--goal", 9, 9, cwd=tmp_path)
    assert done.returncode == 2
    assert "spacearm workspace" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        "planar3 --task x,y 0.3 0.7 0.5 --goal 0.5 1",  # redundant: no shells to draw
        "planar2 --task x 0.8 0.6 --goal 1.9",  # y is left open
        "mda6 --task x,y 0 1 -1.7 -0.9 0.5 0 --goal 1.6 0.1",
    ],
)
def test_command_draws_every_task(tmp_path, words):
    done = run(*words.split(), "--output", "plan.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "wrote plan.png" in done.stdout
