"""Sweeps on this machine: the numbers, what survives what, what is refused, the command."""

import json
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from helpers.arms import robot, two_links
from helpers.sweeps import STUDY, files, run, start, wait_for_chunks
from hypothesis import given
from hypothesis import strategies as st

import spacearm as sa
from spacearm.sweeps.estimates import estimate
from spacearm.sweeps.quantities import boxes
from spacearm.sweeps.runner import do, run_chunks, status
from spacearm.sweeps.store import Store, dataset
from spacearm.sweeps.study import Chunk

zarr = pytest.importorskip("zarr")  # which needs Python 3.11


@pytest.mark.slow
def test_the_numbers_are_those_of_the_functions(study, whole):
    ds = sa.sweep(study, whole)
    assert ds["sigma_min"].dims == ("arm", "base_inertia", "q1", "joint_2")
    assert ds["configurations"].dims == ("arm", "base_inertia", "block", "radius")
    assert ds["arm"].values.tolist() == ["planar2", "chaser"]
    for name, arm in study.arms.items():
        arm = sa.design.vary(arm, {"base_inertia": 3})
        point = ds["sigma_min"].sel(arm=name, base_inertia=3).isel(q1=11, joint_2=77)
        q = np.zeros(arm.n)
        q[:2] = point["q1"], point["joint_2"]
        assert float(point) == pytest.approx(sa.singularity(arm.at(q)).sigma_min, abs=1e-12)
        counts = ds.sel(arm=name, base_inertia=3).sum("block")
        edges = np.linspace(0, 6, 7)
        one = sa.risk_profile(arm, sigma_min=0.2, bins=edges, samples=200_000, seed=9)
        assert float(counts["configurations"].sum()) == 80_000  # nothing is beyond 6 m
        there = one.count > 5000
        share = (counts["near"] / counts["configurations"]).values
        assert np.abs(share - one.share)[there].max() < 5 * 2 * one.error[there].max()


@given(st.lists(st.integers(1, 9), max_size=4), st.integers(1, 40))
def test_tiles_cover_a_grid_once(shape, most):
    seen = np.zeros(shape, dtype=int)
    for box in boxes(shape, most):
        assert seen[box].size <= most
        seen[box] += 1
    assert (seen == 1).all()


def test_chunks_larger_than_what_is_in_memory_at_a_time():
    """The same map and the same number of samples, in parts."""
    text = STUDY.replace("4096", "1_000_000").replace("points = 50", "points = 700")
    large = sa.Study.parse(text)
    assert (large.count("risk"), large.count("sigma_min")) == (4, 4)
    arm = large.arms["planar2"]
    found = large.compute(Chunk("sigma_min", 0))["sigma_min"][0, 0]
    a, b = np.meshgrid(np.linspace(-3, 3, 700), np.linspace(-3, 3, 120), indexing="ij")
    Q = np.stack((a.ravel(), b.ravel()), axis=1)
    same = sa.evaluate(arm, Q, ["sigma_min"])["sigma_min"].reshape(a.shape)
    np.testing.assert_array_equal(found, same)
    assert large.compute(Chunk("risk", 0))["configurations"].sum() == 80_000


def test_one_chunk_is_one_chunk():
    study = sa.Study.parse('arms = ["planar2"]\n[shells]')
    assert repr(study) == "Study(1 design of planar2: shells in 1 chunk)"


@pytest.mark.slow
def test_shells_of_redundant_arms_are_sampled_and_say_so():
    study = sa.Study.parse(
        'arms = [{source = "planar2", name = "one row", task = "x"}, "planar2"]\n'
        "[shells]\neffort = 500"
    )
    sampled, certified = (study.compute(Chunk("shells", i)) for i in range(2))
    assert np.ravel(sampled["sampled"]) == 1.0
    assert np.ravel(sampled["gap"]) > 0.0
    assert np.ravel(certified["sampled"]) == 0.0
    assert np.ravel(certified["resolution"]) == 0.0


def test_single_precision_rounds_once(study):
    single = sa.Study.parse(STUDY + "single = true\n")
    found = single.compute(Chunk("sigma_min", 3))["sigma_min"]
    double = study.compute(Chunk("sigma_min", 3))["sigma_min"]
    np.testing.assert_array_equal(found, double.astype(np.float32))


@pytest.mark.slow
def test_shells_are_those_of_the_sweep_in_memory(tmp_path):
    text = """arms = ["planar2"]
    [parameters]
    base_inertia = [1, 5]
    mount_x = {from = 0, to = 0.5, points = 2}
    [shells]
    mode = "free-floating"
    """
    ds = sa.sweep(sa.Study.parse(text), tmp_path / "s.zarr").isel(arm=0)
    same = sa.design.workspaces(sa.load("planar2"), {"base_inertia": [1, 5], "mount_x": [0.0, 0.5]})
    for name in ("piw", "reachable", "fraction"):
        np.testing.assert_array_equal(ds[name], same[name])
    there = same.sizes["shell"]
    np.testing.assert_array_equal(ds["pdw"].isel(shell=slice(there)), same["pdw"])
    assert ds["pdw"].isel(shell=slice(there, None)).isnull().all()


@pytest.mark.slow
def test_attributes_tell_where_the_numbers_come_from(study, whole):

    attrs = sa.sweep(study, whole).attrs
    assert attrs["spacearm_version"] == sa.__version__
    assert attrs["study"] == STUDY
    assert attrs["seed"] == 3
    assert re.fullmatch(r"planar2 sha256:\w{64}\nchaser sha256:\w{64}", attrs["models"])


@pytest.mark.slow
def test_any_number_of_workers_gives_the_same_bits(study, whole, tmp_path):
    sa.sweep(study, tmp_path / "one.zarr", workers=1)
    assert files(tmp_path / "one.zarr") == files(whole)


@pytest.mark.slow
def test_what_is_done_is_not_done_again(study, whole, tmp_path):
    store = tmp_path / "s.zarr"
    shutil.copytree(whole, store)
    before = {path: (store / path).stat().st_mtime_ns for path in files(store)}
    tallies = list(run_chunks(study, store, workers=2))
    assert tallies[-1] == (88, 0, 0, 88)
    assert {path: (store / path).stat().st_mtime_ns for path in files(store)} == before


@pytest.mark.parametrize("damage", ["cut off", "gone"])
def test_labels_and_descriptions_that_are_damaged_are_written_again(study, whole, tmp_path, damage):
    sound = dataset(whole, study)
    store = shutil.copytree(whole, tmp_path / "store")
    labels = [file for name in sound.coords for file in (store / name).rglob("*") if file.is_file()]
    assert labels
    for file in (*labels, store / "chunks" / "zarr.json"):
        if damage == "gone":
            file.unlink()
        else:
            file.write_bytes(file.read_bytes()[:7])
    Store(store, study)
    assert dataset(store, study).identical(sound)


@pytest.mark.slow
@pytest.mark.parametrize("damage", [0, 1, 3, -1, "flip", "gone"])
@pytest.mark.parametrize(
    "file", ["near/c/0/0/1/0", "sigma_min/c/1/1/1/0", "chunks/risk/c/1", "chunks/sigma_min/c/7"]
)
def test_damaged_chunks_are_found_and_redone(study, whole, tmp_path, damage, file):
    store = tmp_path / "s.zarr"
    shutil.copytree(whole, store)
    content = (store / file).read_bytes()
    if damage == "gone":
        (store / file).unlink()
    elif damage == "flip":
        (store / file).write_bytes(content[:9] + bytes([content[9] ^ 4]) + content[10:])
        with pytest.raises(ValueError, match="checksum"):  # no reader takes it for numbers
            zarr.open_group(store)[file.split("/c/")[0]][:]
    else:
        (store / file).write_bytes(content[:damage])  # cut off
    opened = Store(store, study)
    (chunk,) = [c for c in study.chunks() if not opened.is_done(c)]
    marked = sum(s.done for s in status(study, store))
    assert marked == (87 if file.startswith("chunks") else 88)
    assert do(study.recipe, str(store), chunk) == "computed"
    assert files(store) == files(whole)


@pytest.mark.slow
def test_a_chunk_that_is_another_s_is_found(study, whole, tmp_path):
    """Sound by its own checksum, but not what the mark says."""
    store = tmp_path / "s.zarr"
    shutil.copytree(whole, store)
    blocks = store / "near" / "c" / "0" / "0"
    shutil.copy(blocks / "4" / "0", blocks / "5" / "0")
    tallies = list(run_chunks(study, store, workers=1))
    assert tallies[-1] == (87, 1, 0, 88)
    assert files(store) == files(whole)


def children(pid):
    """Process ids of a process's children."""
    listed = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True
    )
    return [int(word) for word in listed.stdout.split()]


@pytest.mark.slow
@pytest.mark.parametrize("kind", [signal.SIGKILL, signal.SIGINT])
def test_the_main_process_is_killed_and_run_again(study, study_file, whole, tmp_path, kind):
    store = tmp_path / "s.zarr"
    process = start(study_file, store, "--workers", "2")
    wait_for_chunks(store)
    workers = children(process.pid)
    assert len(workers) == 2
    process.send_signal(kind)
    _, err = process.communicate(timeout=300)
    assert process.returncode == (130 if kind == signal.SIGINT else -kind)
    if kind == signal.SIGINT:
        assert "run the same command again" in err
        assert "Traceback" not in err
    deadline = time.monotonic() + 300
    while any(Path(f"/proc/{pid}/cmdline").exists() for pid in workers):  # none outlives it
        assert time.monotonic() < deadline
        time.sleep(0.05)
    done = status(study, store)[0].done
    assert 0 < done < 80
    tallies = list(run_chunks(study, store, workers=2))
    assert done <= tallies[-1].kept < 88
    assert files(store) == files(whole)


@pytest.mark.slow
def test_a_worker_is_killed_in_mid_run(study_file, whole, tmp_path):
    store = tmp_path / "s.zarr"
    process = start(study_file, store, "--workers", "2")
    wait_for_chunks(store)
    os.kill(children(process.pid)[0], signal.SIGKILL)
    out, err = process.communicate(timeout=600)
    assert process.returncode == 0, err
    assert "88 computed, 0 failed" in out
    assert files(store) == files(whole)


@pytest.mark.slow
def test_disk_full(study_file, whole, tmp_path):
    """In a file system of its own with room for a part of the store; then it is enlarged."""
    sweep = f"{sys.executable} -m spacearm sweep {study_file} --store disk/s.zarr --workers 2"
    script = f"""
        mkdir disk && mount -t tmpfs -o size=400k none disk || exit 77
        {sweep}; echo "code $?"
        mount -o remount,size=50m disk
        {sweep}; echo "code $?"
        cp -r disk/s.zarr copy.zarr
    """
    inside = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", script]
    if not shutil.which("unshare"):
        pytest.skip("no unshare here")
    done = subprocess.run(inside, cwd=tmp_path, capture_output=True, text=True, timeout=600)
    if "code" not in done.stdout:
        pytest.skip(f"no file system of one's own can be mounted here: {done.stderr}")
    assert done.stdout.count("code 2") == 1, done
    assert done.stdout.count("code 0") == 1, done
    assert "No space left" in done.stderr
    assert "Traceback" not in done.stderr
    assert files(tmp_path / "copy.zarr") == files(whole)


@pytest.mark.slow
def test_failed_chunks_are_recorded_and_the_rest_goes_on(tmp_path):
    """An arm that can never do its task has neither shells nor a risk; the other has both."""
    text = """
    arms = [{source = "planar2", name = "flat", task = "x z"}, "planar2"]
    [shells]
    [risk]
    sigma_min = 0.1
    bins = [0, 9]
    samples = 99
    """
    (tmp_path / "s.toml").write_text(text)
    code, out, err = run(tmp_path / "s.toml", tmp_path / "s.zarr", "--workers", "1")
    assert code == 1
    assert "4 chunks, 0 kept, 2 computed, 2 failed" in out
    assert "shells 0" in err
    assert "is impossible at every posture" in " ".join(err.split())
    (shells, risk) = status(sa.Study.parse(text), tmp_path / "s.zarr")
    assert "is impossible at every posture" in shells.failed[0]
    assert "is impossible at every posture" in risk.failed[0]
    assert (shells.done, risk.done) == (1, 1)
    with pytest.raises(sa.SweepError, match="2 of 4 chunks") as caught:
        sa.sweep(tmp_path / "s.toml", tmp_path / "s.zarr", workers=1)
    assert list(caught.value.failed) == ["shells 0", "risk 0"]
    ds = dataset(tmp_path / "s.zarr", sa.Study.read(tmp_path / "s.toml"))
    assert ds["fraction"].isnull().values.tolist() == [True, False]
    assert float(ds["configurations"].sum()) == 99


def test_a_chunk_that_fails_once_is_tried_again(study, tmp_path, monkeypatch):
    tried = []

    class Stumbling:
        width, lost, final = 3, False, ()

        def __init__(self, *_):
            pass

        def submit(self, work, chunk):
            future = Future()
            if work is do:
                tried.append(chunk)
            if work is do and chunk.number == 5 and tried.count(chunk) == 1:
                future.set_exception(RuntimeError("a stumble"))
            else:
                future.set_result(work(study.recipe, str(tmp_path / "s.zarr"), chunk))
            return future

        def close(self):
            pass

    monkeypatch.setattr(sys.modules["spacearm.sweeps.runner"], "_workers", Stumbling)
    tallies = list(run_chunks(study, tmp_path / "s.zarr"))
    assert tallies[-1] == (0, 88, 0, 88)
    assert tried.count(Chunk("risk", 5)) == 2
    assert tried.count(Chunk("risk", 6)) == 1


@pytest.mark.slow
def test_other_studies_and_models_are_refused(tmp_path, whole):
    other = sa.Study.parse(STUDY.replace("seed = 3", "seed = 4"))
    with pytest.raises(sa.StoreError, match=r"study has 'seed = 3' where this one has 'seed = 4'"):
        sa.sweep(other, whole)
    arm = tmp_path / "mine.urdf"
    shutil.copy(sa.load("planar2").path, arm)
    text = 'arms = ["mine.urdf"]\n[sigma_min]\njoints.q1 = [0.1, 0.2]'
    (tmp_path / "s.toml").write_text(text)
    sa.sweep(tmp_path / "s.toml", tmp_path / "s.zarr", workers=1)
    arm.write_text(arm.read_text().replace('<mass value="', '<mass value="1', 1))
    with pytest.raises(sa.StoreError, match="its models has 'mine sha256"):
        sa.sweep(tmp_path / "s.toml", tmp_path / "s.zarr", workers=1)


@pytest.mark.parametrize("key", ["shape", "codecs"])
def test_arrays_that_are_described_otherwise_are_refused(study, whole, tmp_path, key):
    store = tmp_path / "s.zarr"
    shutil.copytree(whole, store)
    file = store / "near" / "zarr.json"
    described = json.loads(file.read_text())
    described[key] = [*described[key][:-1], 7]
    file.write_text(json.dumps(described))
    with pytest.raises(sa.StoreError, match=r"near.zarr.json does not describe"):
        sa.sweep(study, store)


def test_no_pickle_of_a_store_is_ever_loaded(study, tmp_path):
    """A store of Zarr's second format whose codec unpickles: refused before anything is read."""
    import numcodecs

    trap, fired = tmp_path / "trap.zarr", tmp_path / "fired"

    class Bomb:
        def __reduce__(self):
            return (Path.touch, (fired,))

    group = zarr.open_group(trap, mode="w", zarr_format=2)
    group.attrs.update(study.attributes)
    payload = np.array([Bomb()], dtype=object)
    (trap / "near").mkdir()
    meta = {
        "zarr_format": 2, "shape": [1], "chunks": [1], "dtype": "|O", "fill_value": None,
        "order": "C", "compressor": None, "filters": [{"id": "pickle", "protocol": 5}],
    }  # fmt: skip
    (trap / "near" / ".zarray").write_text(json.dumps(meta))
    (trap / "near" / "0").write_bytes(numcodecs.Pickle().encode(payload))
    with pytest.raises(sa.StoreError, match="not the store of a sweep"):
        sa.sweep(study, trap)
    assert not fired.exists()


@pytest.mark.parametrize("there", ["file", "folder"])
def test_other_things_in_the_way_are_left_alone(study, tmp_path, there):
    store = tmp_path / "s.zarr"
    if there == "file":
        store.write_text("mine")
    else:
        store.mkdir()
        (store / "mine").write_text("mine")
    with pytest.raises(sa.StoreError, match="not the store of a sweep"):
        sa.sweep(study, store)
    assert len(files(tmp_path)) == 1


@pytest.mark.slow
def test_plan_status_and_dry_run(study, study_file, whole, tmp_path):
    plans = estimate(study)
    assert [(p.quantity, p.chunks) for p in plans] == [("risk", 80), ("sigma_min", 8)]
    assert plans[1].nbytes == 4 * 50 * 120 * 8
    assert all(p.seconds > 0 for p in plans)
    assert [(s.done, s.failed) for s in status(study, whole)] == [(80, {}), (8, {})]
    code, out, _ = run(study_file, tmp_path / "s.zarr", "--dry-run", "--workers", "3")
    assert code == 0
    assert re.search(r"(about|at least) \d:\d\d:\d\d on [123] free core", out)
    assert "MB free" in out
    assert [p.name for p in tmp_path.iterdir()] == ["study.toml"]
    code, out, _ = run(study_file, whole, "--status")
    assert code == 0
    assert "100.0%" in out


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ('"planar2"', '"planar9"', sa.ModelError, "planar9"),
        ('"planar2", {', '{source = "planar2", nam = "x"}, {', sa.ConfigurationError, "name"),
        ('name = "chaser"', 'name = "planar2"', sa.ConfigurationError, "two are named"),
        ("seed = 3", "seed = -1", sa.ConfigurationError, "from 0 on"),
        ("seed = 3", "seed = 3.5", sa.ConfigurationError, "whole number"),
        (
            "chunk = 4096",
            "chunk = 0",
            sa.ConfigurationError,
            "chunk is 0; give",
        ),
        ("chunk = 4096", "chunks = 4096", sa.ConfigurationError, "valid, nearest first: chunk"),
        ("base_inertia", "base_weight", sa.ConfigurationError, "base_mass"),
        ("[1, 3]", "[1, -3]", sa.ModelError, "positive"),
        ("[1, 3]", "[1, 1]", sa.ConfigurationError, "different"),
        ("[1, 3]", '["a"]', sa.ConfigurationError, "list of numbers"),
        ("[1, 3]", "[]", sa.ConfigurationError, "one or more"),
        ("[1, 3]", "[1, nan]", sa.ConfigurationError, "numbers up to"),
        ("to = 6", "to = -6", sa.ConfigurationError, "increasing edges"),
        ("points = 50", "points = 0.5", sa.ConfigurationError, "whole number"),
        ("points = 50", "points = 50_000_000", sa.ConfigurationError, "from 1 to 10,000,000"),
        ("joints.q1", "joints.q9", sa.ConfigurationError, "unknown joint"),
        ("joints.q1", "joints.q2", sa.ConfigurationError, "none twice"),
        ("[sigma_min]", "[sigma_min]\nheld.q1 = 0.2", sa.ConfigurationError, "not in"),
        ("[sigma_min]", "[sigma_max]", sa.ConfigurationError, "sigma_min"),
        ("[sigma_min]", "[shells]\nmode = 'fix'\n[sigma_min]", sa.ConfigurationError, "fixed"),
        ("joints.q1", "joints.near", sa.ConfigurationError, "unknown joint"),
        (STUDY, "arms = []", sa.ConfigurationError, "name one or more"),
        (
            STUDY,
            "arms = ['planar2']",
            sa.ConfigurationError,
            "shells, risk, simulation, distance",
        ),
        (STUDY, "arms = [", sa.ConfigurationError, "not TOML"),
    ],
)
def test_bad_studies(old, new, error, message):
    assert old in STUDY
    with pytest.raises(error, match=message):
        sa.Study.parse(STUDY.replace(old, new, 1))


def test_a_study_travels_between_processes(study):
    twin = pickle.loads(pickle.dumps(study))
    assert twin.models == study.models
    chunk = next(study.chunks())
    for name, values in study.compute(chunk).items():
        np.testing.assert_array_equal(twin.compute(chunk)[name], values)


@pytest.mark.parametrize("workers", [1.5, "2", True])
def test_workers_are_whole(study, tmp_path, workers):
    with pytest.raises(sa.ConfigurationError, match=f"workers is {workers!r}"):
        sa.sweep(study, tmp_path / "s.zarr", workers=workers)


@pytest.mark.slow
def test_bad_commands(study_file, tmp_path):
    code, _, err = run(tmp_path / "none.toml", tmp_path / "s.zarr")
    assert code == 2
    assert "none.toml cannot be read" in err
    code, _, err = run(study_file, tmp_path / "s.zarr", "--status")
    assert code == 2
    assert "not the store of a sweep" in err
    locked = tmp_path / "locked"
    locked.write_text("a file")
    with pytest.raises(sa.StoreError, match="File exists"):
        sa.sweep(study_file, locked / "s.zarr")
    with pytest.raises(sa.ConfigurationError, match="workers is 0"):
        sa.sweep(study_file, tmp_path / "s.zarr", workers=0)


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [("<link ", "<!-- the same -->\n<link ", True), ('<mass value="', '<mass value="1', False)],
)
def test_models_are_known_by_their_physics(tmp_path, old, new, same):
    text = sa.load("planar2").path.read_text()
    (tmp_path / "mine.urdf").write_text(text)
    study = 'arms = ["mine.urdf"]\n[shells]\n'
    before = sa.Study.parse(study, tmp_path).models
    (tmp_path / "mine.urdf").write_text(text.replace(old, new, 1))
    assert (sa.Study.parse(study, tmp_path).models == before) is same


@pytest.mark.slow
def test_an_arm_put_together_on_a_bus(tmp_path):
    """Its fingerprint is that of its physics: what it looks like may stand elsewhere."""
    text = 'arms = ["servicer_ur5"]\n[sigma_min]\njoints.q2 = {from = -1, to = 1, points = 5}\n'
    found = sa.sweep(sa.Study.parse(text), tmp_path / "out.zarr")
    arm = sa.load("servicer_ur5")
    Q = np.zeros((5, arm.n))
    Q[:, 1] = np.linspace(-1, 1, 5)
    expected = sa.evaluate(arm, Q, ("sigma_min",))["sigma_min"]
    np.testing.assert_allclose(found["sigma_min"].values.ravel(), expected, atol=1e-12)


def test_arms_of_a_study_in_xacro(tmp_path):
    (tmp_path / "lib" / "bodies").mkdir(parents=True)
    (tmp_path / "lib" / "bodies" / "bodies.xacro").write_text("<robot/>")
    (tmp_path / "robot" / ".git").mkdir(parents=True)
    xacro = 'xmlns:xacro="http://ros.org/wiki/xacro"'
    text = robot(*two_links()).replace("<robot", f"<robot {xacro}").replace('"50.0"', '"$(arg m)"')
    include = '<xacro:include filename="$(find bodies)/bodies.xacro"/></robot>'
    (tmp_path / "robot" / "arm.xacro").write_text(text.replace("</robot>", include))
    study = """arms = [{source = "robot/arm.xacro", packages = ["lib"], xacro_args = {m = 70},
      density = 1000, task = "y"}]\n[shells]"""
    study = study.replace("\n      ", " ")  # TOML: one line
    assert sa.Study.parse(study, tmp_path).arms["arm"].mass == 71.0
    for old, new in (
        ('packages = ["lib"]', "packages = [3]"),
        ('packages = ["lib"]', "packages = 'lib'"),
        ("xacro_args = {m = 70}", "xacro_args = 3"),
        ("density = 1000", "density = -1"),
    ):
        with pytest.raises(sa.ConfigurationError, match=rf"{new.split()[0]} is .*give"):
            sa.Study.parse(study.replace(old, new), tmp_path)


def test_a_number_of_thousands_of_digits(tmp_path):
    with pytest.raises(sa.ConfigurationError, match="the study is not TOML"):
        sa.Study.parse(f"arms = ['planar2']\nseed = {'9' * 5000}\n[shells]\n", tmp_path)


@pytest.mark.parametrize("text", ["[{}]", "{} = 1", "a = {{{} = 1}}"])
def test_keys_of_many_parts_are_refused_before_they_are_parsed(text, monkeypatch):
    monkeypatch.setattr("tomllib.loads", None)
    with pytest.raises(sa.ConfigurationError, match="a key of more than 16 parts"):
        sa.Study.parse(text.format(".".join("a" * 40_000)))


@pytest.mark.parametrize(("begin", "end"), [("[", "]"), ("{a = ", "}")])
def test_what_is_nested_too_deeply_says_so(begin, end):
    with pytest.raises(sa.ConfigurationError, match="within more than 100 others"):
        sa.Study.parse(f"a = {40_000 * begin}1{40_000 * end}")


def test_a_file_of_over_a_megabyte_is_no_study(tmp_path):
    (tmp_path / "large.toml").write_text("#" * 1_000_001)
    with pytest.raises(sa.ConfigurationError, match="larger than 1 MB"):
        sa.Study.read(tmp_path / "large.toml")
