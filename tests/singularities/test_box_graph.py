"""Boxes as a graph: the parts that are known otherwise, and ways that a certificate proves too."""

import zipfile

import numpy as np
import pytest

import spacearm as sa

ENDLESS = ([-np.inf] * 2, [np.inf] * 2)


def holds(boxes, q):
    return ((boxes.lower <= q) & (q <= boxes.upper)).all(axis=1).any()


@pytest.fixture(scope="module")
def planar():
    return sa.free_boxes(sa.load("planar2"), within=ENDLESS)


def test_the_torus_of_the_planar_arm_has_two_parts_of_equal_size(planar):
    """The two curves of figure 4 go once round in q1 each, and part the torus in two bands."""
    assert planar.share >= 0.99
    assert len(planar.part_shares) == 2
    assert planar.part_shares == pytest.approx(0.5, abs=0.01)  # S(-q) = -S(q)


def test_boxes_do_not_overlap_and_hold_no_singular_posture(planar):
    rng = np.random.default_rng(0)
    S = sa.singularity_polynomial(planar.arm)
    Q = planar.lower + (planar.upper - planar.lower) * rng.uniform(size=(20, *planar.lower.shape))
    signs = np.sign(S(Q.reshape(-1, 2)).reshape(20, -1))
    assert (signs == signs[0]).all()
    for part in (0, 1):
        assert len(set(signs[0][planar.parts == part])) == 1
    X = rng.uniform(-np.pi, np.pi, (2000, 2))
    holding = ((planar.lower <= X[:, None]) & (X[:, None] <= planar.upper)).all(axis=2).sum(axis=1)
    assert holding.max() == 1
    assert holding.mean() == pytest.approx(planar.share, abs=0.01)


def test_ways_through_boxes_are_proven_by_the_certificate_too(planar):
    rng = np.random.default_rng(1)
    S, singular = sa.singularity_polynomial(planar.arm), sa.singular_set(planar.arm)
    found = 0
    for q0, q1 in rng.uniform(-np.pi, np.pi, (40, 2, 2)):
        if S(q0) * S(q1) < 0.0:
            with pytest.raises(sa.NoSolutionError, match=r"connected parts|in no box"):
                planar.path(q0, q1)
            continue
        if not (holds(planar, q0) and holds(planar, q1)):  # one in a hundred postures
            continue
        way = planar.path(q0, q1)
        np.testing.assert_array_equal(way[0], q0)
        turns = (way[-1] - q1) / (2.0 * np.pi)
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)
        assert singular.clearance(way).free
        found += 1
    assert found > 10


def test_ways_keep_the_joint_limits():
    arm = sa.load("planar2")
    boxes, rng = sa.free_boxes(arm, share=0.95), np.random.default_rng(2)
    assert not boxes.endless
    ways = 0
    for q0, q1 in rng.uniform(-3.0, 3.0, (20, 2, 2)):
        inside = [
            np.flatnonzero(((boxes.lower <= q) & (q <= boxes.upper)).all(axis=1)) for q in (q0, q1)
        ]
        if not all(map(len, inside)) or boxes.parts[inside[0][0]] != boxes.parts[inside[1][0]]:
            continue
        way = boxes.path(q0, q1)
        assert (way >= arm.lower).all()
        assert (way <= arm.upper).all()
        np.testing.assert_allclose(way[-1], q1, atol=1e-12)
        ways += 1
    assert ways


@pytest.mark.slow
def test_it_goes_on_from_a_file(tmp_path):
    arm = sa.load("mda6")
    first = sa.free_boxes(arm, most=60_000)
    read = sa.FreeBoxes.load(first.save(tmp_path / "boxes.npz"), arm, "free-floating")
    more = sa.free_boxes(arm, most=120_000, so_far=read)
    assert 0.0 < first.share < more.share < 1.0
    rng, S = np.random.default_rng(0), sa.singularity_polynomial(arm)
    Q = more.lower + (more.upper - more.lower) * rng.uniform(size=(5, *more.lower.shape))
    signs = np.sign(S(Q.reshape(-1, arm.n)).reshape(5, -1))
    assert (signs == signs[0]).all()
    with pytest.raises(sa.StoreError, match="not those"):
        sa.FreeBoxes.load(tmp_path / "boxes.npz", sa.load("planar2"), "free-floating")
    with pytest.raises(sa.ConfigurationError, match="another arm"):
        sa.free_boxes(sa.load("planar2"), so_far=read)


@pytest.mark.parametrize("after", [1, 5])
def test_after_ctrl_c_there_is_what_was_covered_and_it_goes_on(after, planar):
    told = []

    def stop(done, _):
        told.append(done)
        if len(told) == after:
            raise KeyboardInterrupt

    with pytest.raises(sa.StoppedError, match="of the joint range covered") as stopped:
        sa.free_boxes(planar.arm, within=ENDLESS, progress=stop)
    whole = sa.free_boxes(planar.arm, so_far=stopped.value.best)
    assert whole.share == pytest.approx(planar.share, abs=1e-12)
    assert whole.part_shares == pytest.approx(planar.part_shares, abs=1e-12)


def test_boxes_go_on_for_another_payload_and_for_no_other_spacecraft():
    arm = sa.load("planar3")
    first = sa.free_boxes(arm, most=200)
    held = sa.free_boxes(arm.replace(payload=50.0), so_far=first)
    assert held.share > max(first.share, 0.98)
    again = sa.free_boxes(sa.load("planar3"), so_far=first)
    assert held.share == pytest.approx(again.share, abs=0.01)
    for other, mode in ((arm.replace(base_mass=500.0), "free-floating"), (arm, "fixed")):
        with pytest.raises(sa.ConfigurationError, match="another arm or mode"):
            sa.free_boxes(other, so_far=first, mode=mode)


def test_no_cell_is_left_untried(planar):
    """Trying them again finds no more that are free."""
    first = sa.free_boxes(planar.arm, within=ENDLESS, most=200)
    assert 0.5 < first.share < planar.share
    again = sa.free_boxes(planar.arm, so_far=first, most=200)
    assert again.share == first.share


def test_a_joint_that_cannot_move_takes_no_share():
    """The boxes are those of the others; of planar3 nothing depends on the last joint."""
    arm = sa.load("planar3")
    held = arm.replace(lower={"joint_3": 0.3}, upper={"joint_3": 0.3})
    free, still = (sa.free_boxes(a, most=3000) for a in (arm, held))
    np.testing.assert_array_equal(still.lower[:, :2], free.lower[:, :2])
    np.testing.assert_allclose(still.part_shares, free.part_shares, atol=1e-12)
    bent = arm.replace(lower={"joint_2": 0.8}, upper={"joint_2": 0.8})
    assert sa.free_boxes(bent, most=3000).share >= 0.99


def test_a_share_that_cannot_be_is_named():
    with pytest.raises(sa.ConfigurationError, match=r"share is 1\.5"):
        sa.free_boxes(sa.load("planar2"), share=1.5)


def test_boxes_are_not_those_of_an_arm_of_the_same_name_with_other_masses(planar, tmp_path):
    path, arm = planar.save(tmp_path / "boxes.npz"), sa.load("planar2")
    read = sa.FreeBoxes.load(path, arm, "free-floating")
    assert read.share == planar.share
    for other in (arm.replace(base_mass=80.0), arm.replace(link_length={"link_1": 0.9})):
        assert other.name == arm.name
        with pytest.raises(sa.StoreError, match="of another planar2"):
            sa.FreeBoxes.load(path, other, "free-floating")


def test_files_that_hold_no_boxes_or_too_many_are_told(tmp_path):
    path, arm = tmp_path / "boxes.npz", sa.load("planar2")
    for content, why in ((b"x", "not a zip file"), (None, "3 GB, and 2 GB at most")):
        if content is None:  # a small file that would take 3 GB
            with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
                packed.writestr("low.npy", b"")
            # what the directory states is believed before anything is unpacked
            raw = path.read_bytes()
            entry = raw.rindex(b"PK\x01\x02") + 24
            content = raw[:entry] + (3 * 10**9).to_bytes(4, "little") + raw[entry + 4 :]
        path.write_bytes(content)
        with pytest.raises(sa.StoreError, match=why):
            sa.FreeBoxes.load(path, arm, "free-floating")
