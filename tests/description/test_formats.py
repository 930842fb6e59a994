"""A robot in another format is the same robot."""

import warnings

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, random_base, random_tree, seeds
from helpers.formats import as_mjcf, as_pinocchio, as_sdf
from hypothesis import given, settings
from hypothesis import strategies as st

import spacearm as sa

TASK = sa.Task("pose", length=1.0)


def load_as(text, suffix, folder, **options):
    path = folder / f"robot{suffix}"
    path.write_text(text, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sa.load(path, **options)


def same(ours, theirs, seed):
    """The same joints, limits, masses and J* at a random configuration."""
    rng = np.random.default_rng(seed)
    assert set(ours.joint_names) == set(theirs.joint_names)
    assert ours.mass == pytest.approx(theirs.mass, rel=1e-14)
    order = [theirs.joint_names.index(name) for name in ours.joint_names]
    np.testing.assert_allclose(ours.lower, theirs.lower[order], atol=1e-12)
    np.testing.assert_allclose(ours.upper, theirs.upper[order], atol=1e-12)
    q, base = rng.uniform(-3, 3, theirs.n), random_base(rng)
    A, B = ours.at(q[order], base=base), theirs.at(q, base=base)
    assert A.tip.isApprox(B.tip, 1e-12)
    J, K = sa.generalized_jacobian(A), sa.generalized_jacobian(B)[:, order]
    np.testing.assert_allclose(J, K, atol=1e-12 * max(1.0, np.abs(K).max()))


@given(seeds, st.integers(1, 7))
@settings(max_examples=15)
def test_mjcf_is_the_urdf(tmp_path_factory, seed, n):
    arm = load_text(random_tree(seed, n), tip=f"link_{n}", task=TASK)
    text = as_mjcf(arm.tree, np.random.default_rng(seed))
    twin = load_as(text, ".xml", tmp_path_factory.mktemp("m"), tip=f"link_{n}_frame", task=TASK)
    same(twin, arm, seed)


@given(seeds, st.integers(1, 7), st.sampled_from(["1.5", "1.6", "1.7", "1.9", "1.11"]))
def test_sdf_is_the_urdf(tmp_path_factory, seed, n, version):
    arm = load_text(random_tree(seed, n), tip=f"link_{n}", task=TASK)
    text = as_sdf(arm.tree, np.random.default_rng(seed), version)
    twin = load_as(text, ".sdf", tmp_path_factory.mktemp("s"), tip=f"link_{n}_frame", task=TASK)
    same(twin, arm, seed)


@given(seeds, st.integers(1, 7), st.booleans(), st.booleans())
@settings(max_examples=15)
def test_a_model_of_pinocchio_is_the_urdf(seed, n, free, by_pinocchio):
    text = random_tree(seed, n)
    if by_pinocchio:  # it has no continuous joints that follow others
        text = text.replace('"continuous"', '"revolute"')
    arm = load_text(text, tip=f"link_{n}", task=TASK)
    model = as_pinocchio(arm.tree, free)
    if by_pinocchio:
        root = [pin.JointModelFreeFlyer()] if free else []
        model = pin.buildModelFromXML(text, *root, mimic=True)
    elif len(arm.joint_names) < n:
        return  # its joints that mimic others are free
    same(sa.load(model, tip=f"link_{n}", task=TASK), arm, seed)


@given(seeds, st.integers(1, 7))
@settings(max_examples=15)
def test_momentum_and_tip_are_those_of_mujoco(tmp_path_factory, seed, n):
    """Its own momentum matrix, and its velocity of the tip where that momentum is zero."""
    rng = np.random.default_rng(seed)
    tree = load_text(random_tree(seed, n), tip=f"link_{n}", task=TASK).tree
    text = as_mjcf(tree, rng)
    arm = load_as(text, ".xml", tmp_path_factory.mktemp("m"), tip=f"link_{n}_frame", task=TASK)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    cfg = arm.at(rng.uniform(-3, 3, arm.n), base=random_base(rng))
    q, rates = arm.all_joints(cfg.q), rng.normal(size=arm.n)
    x, y, z, w = pin.Quaternion(cfg.base.rotation).coeffs()
    data.qpos[:7] = [*cfg.base.translation, w, x, y, z]
    v_b = sa.base_velocity(cfg, rates)
    data.qvel[:6] = [*v_b[:3], *cfg.base.rotation.T @ v_b[3:]]  # it turns in its own axes
    names = list(arm.model.names)[2:]
    for name, position, rate in zip(names, q, arm.all_rates(rates), strict=True):
        joint = model.joint(name)
        data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = position, rate
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    A = np.zeros((3, model.nv))
    mujoco.mj_angmomMat(model, data, A, 1)
    scale = np.abs(A).max()
    assert np.abs(A @ data.qvel).max() < 1e-10 * scale
    np.testing.assert_allclose(data.subtree_com[1], cfg.com, atol=1e-12)
    A_q = np.column_stack([A[:, model.joint(name).dofadr[0]] for name in names])
    A_q = A_q if arm.coupling is None else A_q @ arm.coupling
    np.testing.assert_allclose(sa.momentum_matrix(cfg).A_q[3:], A_q, atol=1e-12 * scale)
    J = np.zeros((6, model.nv))
    site = model.site(f"link_{n}_frame").id
    mujoco.mj_jacSite(model, data, J[:3], J[3:], site)
    K = sa.generalized_jacobian(cfg) @ rates
    np.testing.assert_allclose(J @ data.qvel, K, atol=1e-10 * max(1.0, np.abs(K).max()))
