"""A study of several designs on the cores of this machine, or of a Dask cluster (client=).

Takes pip install "spacearm[sweep]".
"""

from tempfile import TemporaryDirectory

import spacearm as sa

STUDY = """
arms = ["planar2"]
[parameters]
base_inertia = [1, 2, 5]
[risk]
distance = 0.1
radius = {from = 0.0, to = 2.4, points = 4}
samples = 1000
"""

if __name__ == "__main__":  # processes import this file
    with TemporaryDirectory() as folder:
        found = sa.sweep(sa.Study.parse(STUDY), f"{folder}/out.zarr", workers=1)
        print((found["near"].sum("block") / found["configurations"].sum("block")).values.round(3))
