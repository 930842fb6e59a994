"""Many configurations at once, beside a Python loop and beside peers, on the same arms.

    python benchmarks/batch.py

Prints microseconds a configuration and ratios for the least singular value and the determinant
(square tasks) of chaser7 and mda6: spacearm on one and two threads; a Python loop over Pinocchio
with numpy's svd; adam (jax, compiled, vectorised), MuJoCo and Drake where they are installed; and
Pinocchio in C++ (`pinocchio.cpp` beside this file, where g++ and Eigen are found; it computes the
determinant of J J^T, which is less). Then the scaling from one thread to two, and what the first
call costs.

    python benchmarks/batch.py memory

evaluates 10^8 configurations of chaser7 from one memory map (float32, 2.8 GB) into another and
prints the largest resident memory on the way.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "2")

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

import spacearm as sa

HERE = Path(__file__).resolve().parent
ROUNDS = 7


def best(work: Callable[[], object], rounds: int = ROUNDS) -> float:
    """The shortest of several runs [s]; the first, which compiles, does not count."""
    work()
    seconds = []
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def spacearm(arm: sa.SpaceArm, Q: np.ndarray, threads: int) -> Callable[[], object]:
    return lambda: sa.evaluate(arm, Q, ("sigma_min", "determinant"), threads=threads)


def python_loop(arm: sa.SpaceArm, Q: np.ndarray) -> Callable[[], object]:
    model, data = arm.model, arm.model.createData()
    frame, axes = arm.tip_frame, pin.LOCAL_WORLD_ALIGNED
    rows, scale = arm.task.indices, arm.task.scale
    full = np.zeros(model.nq)
    full[6] = 1.0

    def loop() -> np.ndarray:
        sigma = np.empty(len(Q))
        for i, q in enumerate(Q):
            full[7:] = q
            A = pin.computeCentroidalMap(model, data, full)
            J = pin.computeFrameJacobian(model, data, full, frame, axes)
            J_star = J[:, 6:] - J[:, :6] @ np.linalg.solve(A[:, :6], A[:, 6:])
            sigma[i] = np.linalg.svd(scale * J_star[rows], compute_uv=False)[-1]
        return sigma

    return loop


def mujoco_loop(arm: sa.SpaceArm, Q: np.ndarray) -> Callable[[], object]:
    import mujoco

    options = '<mujoco><compiler fusestatic="false" balanceinertia="true"/></mujoco></robot>'
    spec = mujoco.MjSpec.from_string(arm.path.read_text().replace("</robot>", options))
    spec.worldbody.first_body().add_freejoint()
    model = spec.compile()
    data = mujoco.MjData(model)
    tip = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, arm.tip)
    rows, scale = arm.task.indices, arm.task.scale
    J, M = np.empty((6, model.nv)), np.empty((model.nv, model.nv))

    def loop() -> np.ndarray:
        sigma = np.empty(len(Q))
        for i, q in enumerate(Q):
            data.qpos[7:] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_crb(model, data)
            mujoco.mj_fullM(model, data, M)
            mujoco.mj_jacBody(model, data, J[:3], J[3:], tip)
            J_star = J[:, 6:] - J[:, :6] @ np.linalg.solve(M[:6, :6], M[:6, 6:])
            sigma[i] = np.linalg.svd(scale * J_star[rows], compute_uv=False)[-1]
        return sigma

    return loop


def adam_vectorised(arm: sa.SpaceArm, Q: np.ndarray) -> Callable[[], object]:
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from adam import Representations
    from adam.jax import KinDynComputations

    kin = KinDynComputations(str(arm.path), list(arm.joint_names))
    kin.set_frame_velocity_representation(Representations.MIXED_REPRESENTATION)
    rows, scale, H = jnp.array(arm.task.indices), jnp.array(arm.task.scale), jnp.eye(4)

    def one(q):
        A = kin.centroidal_momentum_matrix(H, q)
        J = kin.jacobian(arm.tip, H, q)
        J_star = J[:, 6:] - J[:, :6] @ jnp.linalg.solve(A[:, :6], A[:, 6:])
        return jnp.linalg.svd(scale * J_star[rows], compute_uv=False)[-1]

    many = jax.jit(jax.vmap(one))
    return lambda: np.asarray(many(Q))


def pinocchio_in_cpp(arm: sa.SpaceArm, Q: np.ndarray, threads: int, folder: Path) -> float:
    """Seconds a configuration, or an error that says what is missing."""
    program, points, model = folder / "pinocchio", folder / "Q", folder / "model"
    if not program.exists():
        build(program)
    Q.astype(np.float64).tofile(points)
    arm.model.saveToBinary(str(model))
    rows = " ".join(map(str, arm.task.indices))
    run = [program, model, arm.tip, points, threads, rows]
    done = subprocess.run([str(x) for x in run], capture_output=True, text=True, check=True)
    return float(done.stdout)


def build(program: Path) -> None:
    prefix = Path(pin.__file__).parents[4]
    eigen = Path("/usr/include/eigen3")
    if not (shutil.which("g++") and eigen.is_dir()):
        raise ImportError("g++ or Eigen (apt-get install g++ libeigen3-dev)")
    command = ["g++", "-O3", "-march=native", "-DNDEBUG", "-std=c++17", "-fopenmp", "-w"]
    command += ["-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS", "-DBOOST_MPL_LIMIT_LIST_SIZE=30"]
    command += [f"-I{prefix}/include", f"-I{eigen}", HERE / "pinocchio.cpp", "-o", program]
    command += [f"-L{prefix}/lib", f"-Wl,-rpath,{prefix}/lib"]
    command += ["-lpinocchio_default", "-lboost_serialization"]
    built = subprocess.run([str(x) for x in command], capture_output=True, text=True)
    if built.returncode:
        raise ImportError(
            "a compilation: " + next(line for line in built.stderr.splitlines() if "error" in line)
        )


def compare(name: str, folder: Path) -> None:
    arm = sa.load(name)
    rng = np.random.default_rng(0)
    Q = rng.uniform(-np.pi, np.pi, (1_000_000, arm.n))
    few = Q[:3000]
    loop = python_loop(arm, few)
    difference = abs(sa.evaluate(arm, few)["sigma_min"] - loop()).max()
    seconds = {"Python loop over Pinocchio, numpy svd": best(loop, 3) / len(few)}
    for label, peer, batch in (
        ("MuJoCo in a Python loop, numpy svd", mujoco_loop, few),
        ("adam, jax, jit and vmap, jax svd", adam_vectorised, Q[:100_000]),
    ):
        try:
            work = peer(arm, batch)
            difference_of_peer = abs(work() - sa.evaluate(arm, batch)["sigma_min"]).max()
            seconds[label] = best(work, 3) / len(batch)
            print(f"{name}: {label.split(',')[0]} differs by {difference_of_peer:.0e}")
        except ImportError as missing:
            print(f"{name}: {label} left out: {missing}")
    for threads in (1, 2):
        label = f"Pinocchio in C++, det J J^T only, {threads} thread(s)"
        try:
            seconds[label] = pinocchio_in_cpp(arm, Q[:200_000], threads, folder)
        except ImportError as missing:
            print(f"{name}: {label} left out: it takes {missing}")
    for threads in (1, 2):
        seconds[f"spacearm.evaluate, {threads} thread(s)"] = best(spacearm(arm, Q, threads)) / len(
            Q
        )
    one, two = (seconds[f"spacearm.evaluate, {threads} thread(s)"] for threads in (1, 2))

    print(f"\n{name}: sigma_min and determinant (largest difference {difference:.0e})")
    print(f"{'':46}{'us':>9}{'times spacearm on two':>24}")
    for label, value in seconds.items():
        print(f"{label:46}{1e6 * value:9.3f}{value / two:24.1f}")
    print(f"from one thread to two: {one / two:.2f} times as fast\n")


def memory(folder: Path, m: int = 100_000_000, block: int = 1_000_000) -> None:
    """Linux only: reads the resident memory of the process after every block."""
    arm = sa.load("chaser7")
    points = np.random.default_rng(0).uniform(-3, 3, (block, arm.n)).astype(np.float32)
    with (folder / "Q").open("wb") as file:
        for _ in range(m // block):
            points.tofile(file)
    Q = np.memmap(folder / "Q", np.float32, "r", shape=(m, arm.n))
    out = {"sigma_min": np.memmap(folder / "sigma_min", np.float32, "w+", shape=(m,))}
    peak = 0

    def watch(*_: int) -> None:
        nonlocal peak
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        peak = max(peak, pages * os.sysconf("SC_PAGE_SIZE"))

    start = time.perf_counter()
    sa.evaluate(arm, Q, ["sigma_min"], out=out, progress=watch)
    seconds = time.perf_counter() - start
    print(f"{m:,} configurations in {seconds:.0f} s, largest resident memory {peak / 1e6:.0f} MB")


def first_call(cache: Path) -> None:
    """The first batch of a machine, which compiles, and that of a later process, which does not."""
    code = (
        "import time, numpy, spacearm as sa; arm = sa.load('chaser7'); Q = numpy.zeros((100, 7));"
        "start = time.perf_counter(); sa.evaluate(arm, Q); print(time.perf_counter() - start)"
    )
    environment = os.environ | {"SPACEARM_CACHE": str(cache)}
    seconds = [
        float(subprocess.check_output([sys.executable, "-c", code], env=environment))
        for _ in range(2)
    ]
    print(f"first batch on a machine {seconds[0]:.1f} s, in a later process {seconds[1]:.1f} s")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        if sys.argv[1:] == ["memory"]:
            memory(Path(folder))
        else:
            first_call(Path(folder) / "cache")
            for name in ("chaser7", "mda6"):
                compare(name, Path(folder))
