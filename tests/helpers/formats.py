"""The same robot in other formats: a tree written as MJCF, as SDF and as a model of Pinocchio.

Bodies get frames of their own, away from their joints, as these formats allow.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from helpers.arms import numbers
from spacearm.description.bodies import Inertial, Joint
from spacearm.description.tree import Tree


def random_pose(rng) -> pin.SE3:
    turn = pin.exp3(rng.uniform(-1.5, 1.5, 3))
    return pin.SE3(turn, rng.normal(size=3) * 0.3)


def body_frames(tree: Tree, rng) -> dict[str, pin.SE3]:
    """A random frame for every link but the root, as its pose in the link's joint frame."""
    return {
        link: pin.SE3.Identity() if link == tree.root else random_pose(rng) for link in tree.links
    }


def about_cm(inertial: Inertial) -> tuple[np.ndarray, np.ndarray]:
    """CM and inertia about it, in link axes."""
    R = inertial.origin.rotation
    return inertial.origin.translation, R @ inertial.inertia @ R.T


def as_mjcf(tree: Tree, rng, base: str = "<freejoint/>") -> str:
    frames = body_frames(tree, rng)
    children: dict[str, list[Joint]] = {link: [] for link in tree.links}
    for joint in tree.depth_first():
        children[joint.parent].append(joint)

    def quat(pose):
        x, y, z, w = pin.Quaternion(pose.rotation).coeffs()
        return numbers([w, x, y, z])

    def body(link: str, pose: pin.SE3, inside: str) -> str:
        out = f'<body name="{link}" pos="{numbers(pose.translation)}" quat="{quat(pose)}">{inside}'
        mine = frames[link]
        if inertial := tree.links[link]:
            com, I = about_cm(inertial)
            R = mine.rotation.T
            I = R @ I @ R.T
            six = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]
            out += (
                f'<inertial pos="{numbers(mine.actInv(com))}" mass="{inertial.mass!r}" '
                f'fullinertia="{numbers(six)}"/>'
            )
        there = mine.inverse()
        out += (
            f'<site name="{link}_frame" pos="{numbers(there.translation)}" quat="{quat(there)}"/>'
        )
        for joint in children[link]:
            away = frames[joint.child]
            at = mine.inverse() * joint.origin * away
            hinge = ""
            if joint.movable:
                kind = "slide" if joint.kind == "prismatic" else "hinge"
                limits = "" if np.isinf(joint.lower) else f'range="{joint.lower} {joint.upper}"'
                hinge = (
                    f'<joint name="{joint.name}" type="{kind}" {limits} '
                    f'pos="{numbers(-away.rotation.T @ away.translation)}" '
                    f'axis="{numbers(away.rotation.T @ joint.axis)}"/>'
                )
            out += body(joint.child, at, hinge)
        return out + "</body>"

    ties = "".join(
        f'<joint joint1="{j.name}" joint2="{j.mimic.leader}" '
        f'polycoef="{j.mimic.offset!r} {j.mimic.multiplier!r} 0 0 0"/>'
        for j in tree.joints.values()
        if j.mimic
    )
    return (
        f'<mujoco model="{tree.name}"><compiler angle="radian" autolimits="true"/><worldbody>'
        f"{body(tree.root, pin.SE3.Identity(), base)}</worldbody>"
        f"<equality>{ties}</equality></mujoco>"
    )


def as_sdf(tree: Tree, rng, version: str = "1.9") -> str:
    """Links placed in the model's frame, or from 1.7 on sometimes relative to their joints."""
    frames = body_frames(tree, rng)
    modern = float(version) >= 1.7
    zero = {tree.root: pin.SE3.Identity()}
    for joint in tree.depth_first():
        zero[joint.child] = zero[joint.parent] * joint.origin
    placed = {link: zero[link] * frames[link] for link in tree.links}

    def pose(value: pin.SE3, relative_to: str = "") -> str:
        to = f' relative_to="{relative_to}"' if relative_to else ""
        rpy = pin.rpy.matrixToRpy(value.rotation)
        return f"<pose{to}>{numbers([*value.translation, *rpy])}</pose>"

    out = [f"<sdf version='{version}'><model name='{tree.name}'>"]
    by_joint = {joint.child: joint for joint in tree.joints.values()}
    for link, inertial in tree.links.items():
        joint = by_joint.get(link)
        if modern and joint and joint.movable and rng.random() < 0.5:
            at = pose(frames[link], joint.name)
        else:
            at = pose(placed[link])
            joint = None
        inside = "<inertial><mass>0</mass></inertial>"
        if inertial:
            com, I = about_cm(inertial)
            turn = pin.SE3(pin.exp3(rng.uniform(-1, 1, 3)), frames[link].actInv(com))
            R = turn.rotation.T @ frames[link].rotation.T
            I = R @ I @ R.T
            entries = "".join(
                f"<i{'xyz'[i]}{'xyz'[j]}>{float(I[i, j])!r}</i{'xyz'[i]}{'xyz'[j]}>"
                for i in range(3)
                for j in range(i, 3)
            )
            inside = (
                f"<inertial>{pose(turn)}<mass>{inertial.mass!r}</mass>"
                f"<inertia>{entries}</inertia></inertial>"
            )
        out.append(f"<link name='{link}'>{at}{inside}</link>")
        if modern:
            mark = pose(frames[link].inverse())
            out.append(f"<frame name='{link}_frame' attached_to='{link}'>{mark}</frame>")
        else:
            out.append(
                f"<link name='{link}_frame'>{pose(zero[link])}<inertial><mass>0</mass></inertial>"
                f"</link><joint name='{link}_mark' type='fixed'><parent>{link}</parent>"
                f"<child>{link}_frame</child></joint>"
            )
    for joint in tree.joints.values():
        child, parent = joint.child, joint.parent
        relative = f'relative_to="{joint.name}"' in "".join(out)
        if relative or (modern and rng.random() < 0.5):
            at = pose(frames[parent].inverse() * joint.origin, parent)
        else:
            at = pose(frames[child].inverse())
        axis = ""
        if joint.movable:
            direction, given = joint.axis, ""
            if modern and rng.random() < 0.5:
                given, direction = (
                    f" expressed_in='{parent}'",
                    frames[parent].rotation.T @ joint.origin.rotation @ joint.axis,
                )
            elif not modern and rng.random() < 0.5:
                axis = "<use_parent_model_frame>true</use_parent_model_frame>"
                direction = zero[child].rotation @ joint.axis
            limits = ""
            if np.isfinite(joint.lower):
                limits = (
                    f"<limit><lower>{joint.lower}</lower><upper>{joint.upper}</upper>"
                    f"<effort>{joint.effort}</effort><velocity>{joint.velocity}</velocity></limit>"
                )
            mimic = ""
            if m := joint.mimic:
                mimic = (
                    f"<mimic joint='{m.leader}'><multiplier>{m.multiplier!r}</multiplier>"
                    f"<offset>{m.offset + m.multiplier * 0.25!r}</offset>"
                    "<reference>0.25</reference></mimic>"
                )
            axis = f"<axis><xyz{given}>{numbers(direction)}</xyz>{axis}{limits}{mimic}</axis>"
        kind = "revolute" if joint.kind == "continuous" else joint.kind
        out.append(
            f"<joint name='{joint.name}' type='{kind}'>{at}<parent>{parent}</parent>"
            f"<child>{child}</child>{axis}</joint>"
        )
    return "".join(out) + "</model></sdf>"


def as_pinocchio(tree: Tree, free: bool) -> pin.Model:
    """Joints of all of Pinocchio's kinds, with its largest numbers where there is no limit."""
    model = pin.Model()
    model.name = tree.name
    root = 0
    if free:
        root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    home = {tree.root: (root, pin.SE3.Identity())}
    for joint in tree.depth_first():
        carrier, placement = home[joint.parent]
        placement = placement * joint.origin
        if joint.movable:
            model_joint = joint.pinocchio()
            if joint.kind == "continuous" and tuple(joint.axis) == (0.0, 0.0, 1.0):
                model_joint = pin.JointModelRUBZ()
            bounds = [joint.effort, joint.velocity, joint.lower, joint.upper]
            bounds = [np.full(1, np.clip(x, -1.7e308, 1.7e308)) for x in bounds]
            if model_joint.nq == 2:
                bounds[2:] = [np.full(2, -1.01), np.full(2, 1.01)]
            carrier = model.addJoint(carrier, model_joint, placement, joint.name, *bounds)
            placement = pin.SE3.Identity()
        home[joint.child] = (carrier, placement)
    for link, (carrier, placement) in home.items():
        if inertial := tree.links[link]:
            model.appendBodyToJoint(carrier, inertial.spatial(), placement)
        model.addBodyFrame(link, carrier, placement, 0)
    return model
