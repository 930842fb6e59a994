"""Two arms on one spacecraft: one moves; what must the other do?"""

import numpy as np

import spacearm as sa

arm = sa.load("dual_ur5", tip="left", joints="all")
cfg = arm.at(np.full(arm.n, 0.4))
other = next(name for name in arm.joint_names if "right" in name)
motion = sa.prescribed_motion(cfg, {other: 0.1})
rates = np.linalg.pinv(motion.jacobian) @ -motion.drift
print(f"{other} turns at 0.1 rad/s; to keep the left tip still:")
print(dict(zip(motion.joints, rates.round(4).tolist(), strict=True)))
sa.plot(cfg).savefig("two_arms.png")
