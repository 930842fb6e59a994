"""Three servos on the paper's arm: damped least squares, one that halts at a condition, sa.Servo.

An operator pushes outward along x, with a little sideways motion, and pulls back again. All three
scale their rates to the same limit. The figure shows the distance to the singular set, searched for
twice a second, and the path of the tip.
"""

import matplotlib.pyplot as plt
import numpy as np

import spacearm as sa

DT, RATE = 0.02, 0.5  # time of a tick [s], largest joint rate [rad/s]
HALTED = 30.0  # the condition number at which it halts, as MoveIt Servo does by default
arm = sa.load("planar2")
start = arm.at(np.radians([30.0, 60.0]))


def wished(t):
    """The twist of the stick (2,) [m/s]."""
    return np.array([0.12 * np.sin(0.25 * t), 0.03 * np.sin(t)])


def damped(cfg, v):
    """Damped least squares, with the damping and the threshold of sa.DampedLeastSquares."""
    U, s, VT = np.linalg.svd(sa.generalized_jacobian(cfg)[:2])
    damping = 0.1**2 * (1.0 - min(s[-1] / 0.1, 1.0) ** 2)
    return VT.T @ (s / (s * s + damping) * (U.T @ v))


def halting(cfg, v):
    """The inverse, at rest from a condition number on."""
    J = sa.generalized_jacobian(cfg)[:2]
    return np.linalg.solve(J, v) if np.linalg.cond(J) < HALTED else np.zeros(2)


servo = sa.Servo(arm, rates=RATE)
servo.start(start)
laws = {
    "damped least squares": damped,
    "halting at a condition": halting,
    "sa.Servo": lambda cfg, v: servo.step(cfg, v, DT).rates,
}
exact = sa.singular_set(arm)
t = DT * np.arange(1250)
_, (left, right) = plt.subplots(1, 2, figsize=(10, 4))
for name, law in laws.items():
    cfg, near, tips, done, asked = start, [], [], 0.0, 0.0
    for moment in t:
        v, J = wished(moment), sa.generalized_jacobian(cfg)[:2]
        dq = law(cfg, v)
        dq = dq / max(1.0, np.abs(dq).max() / RATE)
        done, asked = done + v @ J @ dq, asked + v @ v
        cfg = sa.move(cfg, cfg.q + DT * dq)
        tips.append(cfg.tip.translation[:2])
        near.append(exact.nearest(cfg.q).distance if len(near) % 25 == 0 else near[-1])
    least = np.degrees(min(near))
    print(f"{name:24}{done / asked:5.0%} of the motion, a singular posture found {least:.2f}° away")
    left.plot(t, np.degrees(near), label=name)
    right.plot(*np.transpose(tips), label=name)
left.axhline(5.0, color="k", lw=0.8, ls=":")
left.set(xlabel="time [s]", ylabel="singular posture found [°]")
right.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
left.legend()
plt.tight_layout()
plt.savefig("three_servos.png")
