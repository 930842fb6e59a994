"""Replays of plans by an integrator that shares nothing with the planner."""

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

import spacearm as sa


def replay(plan, row=None, momentum=None):
    """The end, or a row, and the largest turn up to it, by DOP853 on w = D^-1 (h - D_q dq).

    Of a motion that does not know its momentum (6,) it is given.

    The joints follow what `sa.Tracking` wants of them, the wheels a quintic spline.
    """
    arm, start, h = plan.arm, plan[0], plan.momentum[0] if momentum is None else momentum
    wanted, model, data = sa.Tracking(plan).wanted, arm.model, arm.model.createData()
    held = None
    if momentum is None and plan.wheels.any():
        still = [(order, np.zeros(plan.wheels.shape[1])) for order in (1, 2)]
        held = make_interp_spline(plan.t, plan.wheels, k=5, bc_type=(still, still))

    def rate(t, T):
        U, _, Vt = np.linalg.svd(T.reshape(3, 3))
        R, (q, dq, _), kept = U @ Vt, wanted(t), h.copy()
        if held is not None:
            for wheel, spin in zip(arm.wheels, held(t), strict=True):
                kept[3:] -= R @ wheel.axis * spin
        full = np.concatenate((np.zeros(3), pin.Quaternion(R).coeffs(), arm.all_joints(q)))
        A = arm.project(pin.computeCentroidalMap(model, data, full))
        twist = np.linalg.solve(A[:, :6], kept - A[:, 6:] @ dq)  # in the spacecraft's axes
        return (R @ pin.skew(twist[3:]) @ R.T @ T.reshape(3, 3)).ravel()

    row = len(plan) - 1 if row is None else row
    T, attitudes = start.base.rotation.ravel(), [start.base.rotation]
    for t in zip(plan.t[:row], plan.t[1:], strict=False):
        run = solve_ivp(rate, t, T, method="DOP853", rtol=1e-10, atol=1e-11)
        T = run.y[:, -1]
        attitudes += [column.reshape(3, 3) for column in run.y.T]
    U, _, Vt = np.linalg.svd(T.reshape(3, 3))
    turn = max(np.linalg.norm(pin.log3(start.base.rotation.T @ A)) for A in attitudes)
    com = start.com + h[:3] / arm.mass * plan.t[row]
    return arm.at(plan.q[row], base=pin.SE3(U @ Vt, np.zeros(3))).centred(com), turn
