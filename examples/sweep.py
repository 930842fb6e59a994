"""A study of several designs on the workers of a Dask cluster, here two on this machine.

Needs pip install "spacearm[cluster]".
"""

import logging
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
from distributed import Client, LocalCluster

import spacearm as sa

STUDY = """
arms = ["planar2"]
[parameters]
base_inertia = [1, 2, 5]
[risk]
distance = 0.1
bins = {from = 0.0, to = 2.4, points = 4}
samples = 1000
"""

if __name__ == "__main__":  # processes import this file
    with (
        TemporaryDirectory() as folder,
        LocalCluster(2, threads_per_worker=1, dashboard_address=None,
                     silence_logs=logging.CRITICAL) as cluster,
        Client(cluster) as client,
    ):  # fmt: skip
        found = sa.sweep(sa.Study.parse(STUDY), f"{folder}/out.zarr", client=client)
        risk = found["near"].sum("block") / found["configurations"].sum("block")
        print(risk.values.round(3))
    (100 * risk).squeeze().plot.line(x="radius", marker="o")
    plt.ylabel("postures near a singularity [%]")
    plt.savefig("sweep.png")
