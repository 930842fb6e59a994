"""Arms of many joints in a row, and a script that uses one in a thread with little stack."""

import math

from helpers.arms import joint, link, robot

AXES = (0, 0, 1), (0, 1, 0), (1, 0, 0)

#: Arguments: file, joints. All of these functions run machine code.
SCRIPT = """
import sys, threading
import numpy as np
import spacearm as sa

def use():
    arm = sa.load(sys.argv[1])
    q = 0.3 * np.sin(1.0 + np.arange(arm.n))
    Q = np.tile(q, (40, 1))
    sigma = sa.evaluate(arm, Q, ["sigma_min", "determinant", "distance"])
    alone = sa.singularity(arm.at(q))
    np.testing.assert_allclose(sigma["sigma_min"], alone.sigma_min, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(sigma["distance"], alone.distance, rtol=1e-6, atol=1e-9)
    J = sa.generalized_jacobians(arm, Q)
    np.testing.assert_allclose(J[0], sa.generalized_jacobian(arm.at(q)), rtol=1e-9, atol=1e-9)
    rates = np.zeros_like(Q)
    ddq = sa.joint_accelerations(arm, Q, rates, Q)
    one = sa.forward_dynamics(arm.at(q), rates[0], q).ddq
    np.testing.assert_allclose(ddq[0], one, rtol=1e-6, atol=1e-6)
    print("answered")

threading.stack_size(131072)
thread = threading.Thread(target=use)
thread.start()
thread.join()
"""


def in_a_row(n: int) -> str:
    """Return a robot of n revolute joints, one after the other about changing axes."""
    links = [link("l0", 100.0)]
    joints = []
    for i in range(n):
        links.append(link(f"l{i + 1}", 2.0, com=(0.1, 0.01 * math.sin(i), 0.02)))
        joints.append(joint(f"j{i}", f"l{i}", f"l{i + 1}", xyz=(0.2, 0.01, 0.03), axis=AXES[i % 3]))
    return robot(*links, *joints)
