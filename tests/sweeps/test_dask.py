"""Sweeps on a Dask cluster: a scheduler and two workers on loopback, each killed in turn."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress

import pytest
from helpers.commands import Finished, complaints
from helpers.sweeps import STUDY, files, run, start, wait_for_chunks

import spacearm as sa

pytest.importorskip("distributed")  # which needs Python 3.11

from spacearm.sweeps.runner import connect, run_chunks, status


class Dask:
    """A scheduler and two workers, as `dask scheduler` and `dask worker` start them."""

    def __init__(self, folder):
        self.file = folder / "scheduler.json"
        quiet = os.environ | {"DASK_LOGGING__DISTRIBUTED": "critical"}
        where = ["--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0"]

        def dask(*words):
            return subprocess.Popen(
                [sys.executable, "-m", "dask", *words, *where, "--scheduler-file", str(self.file)],
                env=quiet,
            )

        self.scheduler = dask("scheduler", "--port", "0")
        while not self.file.exists():
            assert self.scheduler.poll() is None
            time.sleep(0.05)
        self.workers = [dask("worker", "--no-nanny", "--nthreads", "1") for _ in range(2)]
        self.address = json.loads(self.file.read_text())["address"]

    def __iter__(self):
        return iter((self.scheduler, *self.workers))


@contextmanager
def cluster(folder):
    dask = Dask(folder)
    try:
        client = connect(dask.address)
        client.wait_for_workers(2, timeout=300)
        try:
            yield dask, client
        finally:
            if dask.scheduler.poll() is None:
                client.close(timeout=2)
    finally:
        for process in dask:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    with cluster(tmp_path_factory.mktemp("dask")) as pair:
        yield pair


@pytest.mark.slow
def test_a_cluster_gives_the_same_bits(study, whole, running, tmp_path):
    dask, client = running
    tallies = list(run_chunks(study, tmp_path / "s.zarr", client=client))
    assert tallies[-1] == (0, 88, 0, 88)
    assert files(tmp_path / "s.zarr") == files(whole)
    did = client.run(lambda: len(os.sched_getaffinity(0)) and os.getpid())
    assert sorted(did.values()) == sorted(p.pid for p in dask.workers)


@pytest.mark.slow
def test_nothing_listens_beyond_loopback(running):
    import psutil  # which distributed brings

    dask, _ = running
    for process in (psutil.Process(), *(psutil.Process(p.pid) for p in dask)):
        for connection in process.net_connections():
            assert connection.status != "LISTEN" or connection.laddr.ip in ("127.0.0.1", "::1")


@pytest.mark.slow
def test_the_main_process_is_killed_and_run_again(study, whole, running, tmp_path):
    dask, _ = running
    store, file = tmp_path / "s.zarr", tmp_path / "study.toml"
    file.write_text(STUDY)
    process = start(file, store, "--scheduler", dask.address)
    wait_for_chunks(store)
    process.kill()
    process.communicate()
    assert 0 < status(study, store)[0].done <= 80
    code, out, err = run(file, store, "--scheduler", dask.address)
    assert code == 0, err
    assert "0 failed" in out
    assert files(store) == files(whole)


@pytest.mark.slow
def test_workers_and_scheduler_are_killed_in_mid_run(study, whole, tmp_path):
    with cluster(tmp_path) as (dask, client):

        def kill(process, at):
            return lambda done, _: done == at and process.kill()

        store = tmp_path / "worker.zarr"
        sa.sweep(study, store, client=client, progress=kill(dask.workers[0], 20))
        assert dask.workers[0].wait() == -9
        assert files(store) == files(whole)

        store = tmp_path / "scheduler.zarr"
        with pytest.raises(sa.StoreError, match="scheduler is lost"):
            sa.sweep(study, store, client=client, progress=kill(dask.scheduler, 20))
        done = sum(s.done for s in status(study, store))
        assert 20 <= done < 88
    tallies = list(run_chunks(study, store, workers=1))
    assert done <= tallies[-1].kept < 88
    assert files(store) == files(whole)


@pytest.mark.slow
def test_failures_there_are_recorded(running, tmp_path):
    _, client = running
    flat = '{source = "planar2", name = "flat", task = "x z"}'
    study = sa.Study.parse(f"arms = [{flat}]\n[shells]\n[sigma_min]\njoints.q2 = [0.5, 1.0]")
    with pytest.raises(sa.SweepError, match="1 of 2 chunks") as caught:
        sa.sweep(study, tmp_path / "s.zarr", client=client)
    assert "is impossible at every posture" in caught.value.failed["shells 0"]
    assert [len(s.failed) for s in status(study, tmp_path / "s.zarr")] == [1, 0]


@pytest.mark.slow
def test_a_worker_with_another_model_ends_the_run(running, tmp_path):
    """The URDF changes after the main process has read it."""
    _, client = running
    arm = tmp_path / "mine.urdf"
    arm.write_bytes(sa.load("planar2").path.read_bytes())
    study = sa.Study.parse('arms = ["mine.urdf"]\n[sigma_min]\njoints.q1 = [0.5]', tmp_path)
    arm.write_text(arm.read_text().replace('<mass value="', '<mass value="1', 1))
    with pytest.raises(sa.StoreError, match="not those that the sweep began with"):
        sa.sweep(study, tmp_path / "s.zarr", client=client)
    assert status(study, tmp_path / "s.zarr")[0].done == 0


@pytest.mark.slow
def test_a_store_that_cannot_be_written_ends_the_run(study, whole, running, tmp_path):
    """The marks' folder is a file: an error of the store, not of a chunk."""
    _, client = running
    store = tmp_path / "s.zarr"
    with pytest.raises(sa.StoreError, match="run the same command again"):
        sa.sweep(study, store, client=client, progress=lambda *_: _block(store))
    (store / "near" / "c").unlink()
    sa.sweep(study, store, client=client)
    assert files(store) == files(whole)


def _block(store):
    folder = store / "near" / "c"
    if folder.is_dir():
        folder.rename(store.parent / "aside")
        folder.write_text("in the way")


@pytest.mark.slow
def test_no_scheduler(tmp_path, monkeypatch):
    monkeypatch.setattr("spacearm.sweeps.runner.PATIENCE", 0.3)
    with pytest.raises(sa.StoreError, match="no Dask scheduler at"):
        connect("tcp://127.0.0.1:9")
    for address in ("nonsense", "nonsense://here", "", "tcp://", "tls://127.0.0.1:9", "inproc://x"):
        with pytest.raises(sa.StoreError, match="no Dask scheduler at"):
            connect(address)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(sa.UnsupportedError, match=r"spacearm\[cluster\]"):
        connect("tcp://127.0.0.1:9")
    assert not [*tmp_path.iterdir()]


@pytest.mark.slow
@pytest.mark.parametrize("said", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n" * 50, None])
def test_something_else_that_listens_is_no_scheduler(said, monkeypatch):
    """It says nothing, or something else, or hangs up."""
    monkeypatch.setattr("spacearm.sweeps.runner.PATIENCE", 1)
    kept = []

    def accept(listener):
        with suppress(OSError):
            while True:
                kept.append(listener.accept()[0])
                kept[-1].close() if said is None else kept[-1].sendall(said)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=accept, args=(listener,), daemon=True).start()
        with pytest.raises(sa.StoreError, match="no Dask scheduler at"):
            connect(f"tcp://127.0.0.1:{listener.getsockname()[1]}")
        listener.shutdown(socket.SHUT_RDWR)
    for link in kept:
        link.close()


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_scheduler_that_is_lost_costs_one_line(tmp_path, how):
    (tmp_path / "study.toml").write_text(STUDY.replace("80_000", "80_000_000"))
    dask, store = Dask(tmp_path), tmp_path / "s.zarr"
    try:
        process = start(tmp_path / "study.toml", store, "--scheduler", dask.address)
        wait_for_chunks(store)
        dask.scheduler.send_signal(how)
        _, err = process.communicate(timeout=600)
        assert process.returncode == 2
        (told,) = (line for line in err.splitlines() if not line.startswith("spacearm: chunks:"))
        assert "the cluster's scheduler is lost" in told
    finally:
        for each in dask:
            each.kill()
            each.wait()


@pytest.mark.slow
def test_a_wrong_address_leaves_nothing_behind(tmp_path):
    """A client that was made in part complains when Python ends, after 20 s."""
    (tmp_path / "study.toml").write_text(STUDY)
    code, _, err = run(tmp_path / "study.toml", tmp_path / "s.zarr", "--scheduler", "tls://nowhere")
    assert code == 2
    assert len(complaints(Finished(code, "", err))) == 1
    assert "no Dask scheduler at" in err
