"""Relaxations: which weaker requests are possible where one is proven impossible, by trying.

Where det J* has another sign at joint positions that are asked for, other postures that bring the
tip to the same place on the spacecraft may have that of the start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from warnings import catch_warnings, simplefilter

import numpy as np
import pinocchio as pin

from spacearm.arrays import shape_of
from spacearm.errors import NoSolutionError, listed
from spacearm.planning.account import SearchAccount, TimeUpError
from spacearm.planning.problem import Problem
from spacearm.planning.request import Joints, PlanRequest
from spacearm.planning.result import Plan

#: Time for the tries together [s].
TIME = 3.0
#: Name of the relaxation that takes other joint positions.
SAME_POSE = "another posture of the same pose"
#: Searches for other postures, and how many of those found are tried, nearest first.
SEARCHES, POSTURES = 300, 3
#: How many other tips are tried.
TIPS = 3


def relaxed(request: PlanRequest, find: Callable[[PlanRequest], Plan]) -> str:
    """Return which relaxation of an impossible request was tried and works, in words.

    Args:
        request: What is impossible, of one tip at zero momentum.
        find: Returns the plan for a request.
    """
    account = SearchAccount(TIME, whole=request.account)
    quick = replace(request, account=account, duration=None)
    tries: dict[str, list[PlanRequest]] = {}
    if request.final_attitude is not None:
        tries["final_attitude left open"] = [replace(quick, final_attitude=None)]
    free = replace(quick, constraints=replace(request.constraints, limits=False))
    if isinstance(request.goal, Joints):
        tries[SAME_POSE] = _postures(quick, request.goal)
        if request.constraints.limits:
            tries[f"{SAME_POSE}, limits=False"] = _postures(free, request.goal)
    elif request.constraints.limits:
        tries["limits=False"] = [free]
    tries |= _other_tips(quick)
    for words, requests in tries.items():
        for each in requests:
            try:
                found = find(each)
            except NoSolutionError:
                continue
            ends = f", q = {found.arm.in_words(found.q[-1])}" if SAME_POSE in words else ""
            return f"tried, and works: {words}{ends}, {found.travel}"
    return f"tried without success: {listed(tries)}" if tries else ""


def _other_tips(request: PlanRequest) -> dict[str, list[PlanRequest]]:
    """Return requests of the same goal for other ends of the robot, joints that end there held.

    Joint positions are asked for of the same joints only, rates of each joint likewise.
    """
    start, arm, found = request.start, request.start.arm, dict[str, list[PlanRequest]]()
    known = {**arm.held, **dict(zip(arm.joint_names, start.q.tolist(), strict=True))}
    each = isinstance(request.goal, Joints) or bool(shape_of(request.constraints.rates))
    ends = [link for link in arm.whole.leaves() if link not in arm.tips and arm.whole.movable(link)]
    for link in ends[:TIPS]:
        leading = {arm.whole.leader(joint).name for joint in arm.whole.movable(link)}
        if each and leading != set(arm.joint_names):
            continue
        still = {name: known[name] for name in arm.joint_names if name not in leading}
        with catch_warnings():
            simplefilter("ignore")
            other = arm.replace(tip=link, joints="tip", locked=still)
        if other.n < other.task.k or other.fault_of_task():
            continue
        there = other.at([known[name] for name in other.joint_names], base=start.base)
        found[f"tip={link!r}"] = [replace(request, start=there.centred(start.com))]
    return found


def _postures(request: PlanRequest, goal: Joints) -> list[PlanRequest]:
    """Return requests for other joint positions with the tip as it is in those asked for.

    The spacecraft counts as where it is at the start.
    """
    start = request.start
    there = start.arm.at(goal.q, base=pin.SE3(start.base.rotation, np.zeros(3)))
    to_pose = replace(request, goal=there.centred(start.com).tip, final_attitude=None)
    try:
        problem = Problem.of(to_pose)
        problem.require_side()
        target = problem.target._replace(attitude=start.base.rotation)
        _, Q = problem.guesses(start, target).ends(0.0, SEARCHES)
    except (NoSolutionError, TimeUpError):
        return []
    nearest = Q[np.argsort(np.abs(Q - start.q).sum(axis=1))[:POSTURES]]
    return [replace(request, goal=Joints(q)) for q in nearest]
