"""Stores that somebody else has had in hand, and sweeps that begin or end at an awkward moment."""

import json
import os
import shutil
import sys
import threading
import warnings

import pytest
import xarray as xr
from helpers.arms import joint, link, robot, two_links
from helpers.sweeps import SMALL, STUDY, files, run, start

import spacearm as sa
from spacearm.sweeps.runner import run_chunks
from spacearm.sweeps.store import Store, dataset
from spacearm.sweeps.toml import meaning

pytest.importorskip("zarr")  # which needs Python 3.11

RISK = "[risk]\nsigma_min = 1\nbins = [0, 1]\nsamples = "


@pytest.fixture
def store(sound, tmp_path):
    return shutil.copytree(sound, tmp_path / "s.zarr")


def in_time(call):
    """What a call raises; a fault if it takes long."""
    raised = []

    def catch():
        try:
            call()
        except sa.SpaceArmError as error:
            raised.append(error)

    thread = threading.Thread(target=catch, daemon=True)
    thread.start()
    thread.join(120)
    assert not thread.is_alive()
    return raised


@pytest.mark.slow
@pytest.mark.parametrize(
    "file", ["sigma_min/c/0/0/0", "base_inertia/c/0", "chunks/sigma_min/c/1", "zarr.json",
             "sigma_min/zarr.json"],
)  # fmt: skip
def test_a_pipe_in_a_store_is_refused(small, store, file):
    (store / file).unlink()
    os.mkfifo(store / file)
    (error,) = in_time(lambda: list(run_chunks(small, store, workers=1)))
    assert isinstance(error, sa.StoreError)


@pytest.mark.slow
@pytest.mark.parametrize("part", ["sigma_min/c", "sigma_min", "chunks", "base_inertia"])
def test_nothing_is_written_through_a_link(small, store, tmp_path, part):
    aside = tmp_path / "aside"
    (store / part).rename(aside)
    (store / part).symlink_to(aside)
    victim = next(path for path in sorted(aside.rglob("*")) if path.is_file())
    victim.unlink()
    before = files(aside)
    (error,) = in_time(lambda: list(run_chunks(small, store, workers=1)))
    assert "is a link" in str(error) or "not the store" in str(error)
    assert files(aside) == before


def test_no_more_is_read_than_numbers_take(small, store):
    for file in ("sigma_min/c/0/0/0", "base_inertia/c/0"):
        with (store / file).open("r+b") as large:
            large.truncate(10**10)
    with pytest.raises(sa.StoreError, match=r"bytes, more than its numbers need"):
        Store(store, small).is_done(next(small.chunks()))
    assert (store / "base_inertia/c/0").stat().st_size < 1000  # labels are written again


@pytest.mark.parametrize("size", [0, 1, 200, 300, 70_000, 3_000_000])
def test_packed_files_say_how_long_they_are(size):
    from numcodecs.zstd import compress

    from spacearm.sweeps.store_files import unpacked

    assert unpacked(compress(bytes(size), 1)) == size
    assert unpacked(bytes(size)) == size


@pytest.mark.parametrize(
    ("frame", "much"),
    [
        (b"\xe0" + (2**40).to_bytes(8, "little"), "1,099,511,627,776"),  # a bomb that says so
        (b"\xa0" + (2**31).to_bytes(4, "little"), "2,147,483,648"),
        (b"\x00\x58", "an unknown number of"),  # and one that does not
    ],
)
@pytest.mark.parametrize("file", ["sigma_min/c/0/0/0", "chunks/sigma_min/c/0"])
def test_nothing_unpacks_to_more_than_numbers_take(small, store, file, frame, much):
    """A kilobyte of Zstandard may unpack to a terabyte."""
    zeros = b"\x02\x00\x00" * 400  # blocks of one repeated byte
    (store / file).write_bytes(b"\x28\xb5\x2f\xfd" + frame + zeros + b"\x00" * 4)
    with pytest.raises(sa.StoreError, match=rf"unpacks to {much} bytes, .*; remove it"):
        Store(store, small).is_done(next(small.chunks()))


@pytest.mark.parametrize(
    "change",
    [
        {"attributes": []}, {"attributes": {"scale_factor": 2.0}}, {"attributes": {"units": 7}},
        {"attributes": {"_FillValue": "x"}}, {"attributes": {"coordinates": 5}}, {"extra": [1]},
        {"storage_transformers": [{"name": "x"}]}, {"zarr_format": 7}, {"zarr_format": None},
        {"consolidated_metadata": {"kind": "inline"}},
    ],
)  # fmt: skip
@pytest.mark.slow
@pytest.mark.parametrize("where", ["sigma_min/zarr.json", "zarr.json", "chunks/zarr.json"])
def test_descriptions_that_were_tampered_with(small, store, where, change):
    sound, file = dataset(store, small).load(), store / where
    described = json.loads(file.read_text()) | change
    file.write_text(json.dumps(described))
    try:
        again = sa.sweep(small, store, workers=1).load()
    except sa.StoreError:
        return
    assert again.identical(sound)


@pytest.mark.slow
def test_arrays_of_strangers_are_refused(small, store):
    shutil.copytree(store / "sigma_min", store / "foreign")
    with pytest.raises(sa.StoreError, match=r"foreign is none of this study's arrays"):
        sa.sweep(small, store, workers=1)
    shutil.rmtree(store / "foreign")
    (store / "notes.txt").write_text("mine")
    sa.sweep(small, store, workers=1)
    assert (store / "notes.txt").read_text() == "mine"


@pytest.mark.slow
def test_leftovers_go_and_what_is_the_user_s_own_stays(small, store):
    leftover = store / "sigma_min" / f"0.{'0123abcd' * 4}.partial"
    own = store / "notes.partial"
    for path in (leftover, own):
        path.write_text("half")
    sa.sweep(small, store, workers=1)
    assert not leftover.exists()
    assert own.exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    "text", [f"# a comment\n{SMALL}", SMALL.replace("= [1, 3]", "=[1,3] # kg m²")]
)
def test_a_comment_makes_no_other_study(store, text):
    before = {path: content for path, content in files(store).items() if path.name != "zarr.json"}
    tallies = list(run_chunks(sa.Study.parse(text), store, workers=1))
    assert tallies[-1] == (2, 0, 0, 2)
    assert dataset(store, sa.Study.parse(text)).attrs["study"] == text
    assert {p: c for p, c in files(store).items() if p.name != "zarr.json"} == before


def test_what_a_text_says():
    assert meaning("a = 1 # one") == meaning("a=1") != meaning("a = 2")
    assert meaning("a = [") == "a = ["


def test_a_byte_order_mark(tmp_path):
    path = tmp_path / "study.toml"
    path.write_bytes(b"\xef\xbb\xbf" + SMALL.encode())
    assert sa.Study.read(path).total == 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("points = 4", f"points = {10**27}", "points is 1000"),
        ("[sigma_min]", f"{RISK}{10**27}\n[sigma_min]", "samples is 1"),
        ("[sigma_min]", f"{RISK}{10**15}\n[sigma_min]", "a store has room for"),
        ("arms", f"chunk = {10**27}\narms", "chunk is 1"),
        ("arms", f"chunk = 0x{'f' * 9000}\narms", "chunk is .* 10837 digits; .* to 10,000,000"),
    ],
)
def test_numbers_without_measure(old, new, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.Study.parse(SMALL.replace(old, new, 1))


@pytest.mark.parametrize("mask", [0o077, 0o022])
def test_the_umask_says_who_may_read_a_store(small, tmp_path, mask):
    before = os.umask(mask)
    try:
        Store.create(tmp_path / "s.zarr", small)
    finally:
        os.umask(before)
    assert (tmp_path / "s.zarr").stat().st_mode & 0o777 == 0o777 & ~mask
    assert (tmp_path / "s.zarr" / "zarr.json").stat().st_mode & 0o777 == 0o666 & ~mask


@pytest.mark.filterwarnings("ignore:Consolidated metadata")  # filters are not those of a thread
def test_two_sweeps_create_one_store(small, tmp_path):
    opened = []
    both = threading.Barrier(2)

    def create():
        both.wait()
        opened.append(Store.create(tmp_path / "s.zarr", small))

    threads = [threading.Thread(target=create) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(opened) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["s.zarr"]


@pytest.mark.slow
def test_two_sweeps_begin_together(whole, tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(STUDY)
    both = [start(study, tmp_path / "s.zarr", "--workers", "1") for _ in range(2)]
    for process in both:
        out, err = process.communicate(timeout=300)
        assert process.returncode == 0, err
        assert "0 failed" in out
    assert files(tmp_path / "s.zarr") == files(whole)


@pytest.mark.slow
def test_the_command_says_what_is_wrong_with_a_store(store, tmp_path):
    (store / "chunks" / "sigma_min" / "c" / "0").unlink()
    os.mkfifo(store / "chunks" / "sigma_min" / "c" / "0")
    (tmp_path / "study.toml").write_text(SMALL)
    for option in ("--status", "--workers=1"):
        code, _, err = run(tmp_path / "study.toml", store, option)
        assert code == 2
        assert "is a link, a device or a pipe" in err


def test_the_extra_is_named_where_zarr_is_missing(small, store, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    for there in (store, store / "new"):
        with pytest.raises(sa.UnsupportedError, match=r"pip install 'spacearm\[sweep\]'"):
            sa.sweep(small, there)


def test_xarray_opens_a_store_without_warnings(store):
    """Its description repeats those of its arrays; what the user put there is none of them."""
    (store / "notes.txt").write_text("mine")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with xr.open_zarr(store) as found:
            assert found["sigma_min"].dims == ("arm", "base_inertia", "q1")
            assert found["sigma_min"].attrs["units"] == "m/rad"
            assert found["q1"].attrs["units"] == "rad"


@pytest.mark.parametrize("inside", ["sigma_min", "base_inertia"])
def test_repeated_descriptions_that_were_altered_are_written_again(small, store, inside):
    file = store / "zarr.json"
    sound = file.read_bytes()
    described = json.loads(sound)
    described["consolidated_metadata"]["metadata"][inside]["attributes"] = {"units": "furlong"}
    file.write_text(json.dumps(described))
    Store(store, small)
    assert file.read_bytes() == sound


EVERYTHING = """
arms = [ARM]
[parameters]
base_inertia = [1]
[risk]
sigma_min = 0.2
bins = [0, 6]
samples = 10
[sigma_min]
joints.rail = {from = -0.1, to = 0.1, points = 2}
[distance]
joints.elbow = {from = -0.1, to = 0.1, points = 2}
"""


@pytest.mark.parametrize(("slides", "unit"), [(True, "m"), (False, "rad")])
def test_all_numbers_of_a_store_have_units(tmp_path, slides, unit):
    bus, arm, elbow = two_links()
    path = tmp_path / "robot.urdf"
    last = joint("rail", "arm", "end", "prismatic" if slides else "revolute")
    path.write_text(robot(bus, arm, elbow, link("end"), last))
    source = f'{{source = "{path}", tip = "end", task = "x y"}}'
    study = sa.Study.parse(EVERYTHING.replace("ARM", source))
    units = {name: attrs.get("units") for name, (_, attrs) in study.labels.items()}
    assert units.pop("arm") is None, "it is text"
    assert (units["rail"], units["elbow"]) == (unit, "rad")
    for quantity in study.quantities.values():
        units |= {name: array.attrs.get("units") for name, array in quantity.variables.items()}
    assert all(units.values()), units
    assert units["distance"] == ("rad and m" if slides else "rad")


@pytest.mark.parametrize(
    ("arms", "unit"), [(["planar2"], "m^2"), (["mda6"], "m^3"), (["planar2", "mda6"], "m^2; m^3")]
)
def test_sizes_of_workspaces_have_the_units_of_the_arms(arms, unit):
    study = sa.Study.parse(f"arms = {arms}\n[shells]")
    assert study.quantities["shells"].variables["piw"].attrs["units"] == unit
