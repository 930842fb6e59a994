"""How S changes with the masses: a derivative through the equations, by JAX.

Needs pip install "spacearm[jax]".
"""

import jax
import matplotlib.pyplot as plt
import numpy as np

import spacearm as sa

jax.config.update("jax_enable_x64", True)
fly = sa.to_jax(sa.load("planar2"))
q = np.radians([-65.0, 30.0])
slope = jax.grad(fly.S, argnums=1)(q, fly.parameters)
print("S", float(fly.S(q)))
print("by the masses of spacecraft and links", np.round(slope.masses, 4))
plt.bar(["spacecraft", "link_1", "link_2"], slope.masses)
plt.ylabel("change of S per kilogram")
plt.savefig("jax_design.png")
