"""Signals that end the command line: as Ctrl-C does, with the exit code that shells expect."""

import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios

import pytest

from spacearm import __main__ as entry

SERVE = [sys.executable, "-u", "-m", "spacearm", "view", "planar2", "--no-open"]


@pytest.fixture
def received():
    """Interrupts that come, where the handlers of this process are put back afterwards."""
    numbers = [getattr(signal, name) for name in ("SIGINT", *entry.ENDING)]
    before = {number: signal.getsignal(number) for number in numbers}
    came = []
    for number in numbers:  # some are ignored where tests run under nohup, or behind an ampersand
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    yield came
    for number, handler in before.items():
        signal.signal(number, handler)


def test_each_signal_does_what_ctrl_c_does(received, monkeypatch):
    for name in entry.ENDING:
        received.clear()
        ending = entry._Ending()
        number = getattr(signal, name)
        signal.raise_signal(number)
        signal.raise_signal(number)  # as terminals do that close
        assert received == [signal.SIGINT]
        assert ending.code() == 128 + number
        monkeypatch.setattr(entry, "SAME", 0.0)
        signal.raise_signal(number)  # one that comes later is another one
        assert received == [signal.SIGINT] * 2
        monkeypatch.undo()


@pytest.mark.usefixtures("received")
def test_a_signal_ends_where_ctrl_c_is_ignored():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    entry._Ending()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)


def test_a_signal_that_is_ignored_stays_ignored(received):
    """As nohup has it."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    entry._Ending()
    signal.raise_signal(signal.SIGHUP)
    assert received == []


@pytest.mark.usefixtures("received")
def test_the_exit_code_names_the_signal(monkeypatch, capsys):
    def end(*_, **__):
        signal.raise_signal(signal.SIGTERM)

    signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr("spacearm.load", end)
    monkeypatch.setattr(sys, "argv", ["spacearm", "query", "planar2"])
    with pytest.raises(SystemExit, match="143"):
        entry.main()
    assert capsys.readouterr().err == "spacearm: stopped\n"


@pytest.mark.slow
@pytest.mark.parametrize("name", entry.ENDING)
def test_the_server_of_the_view_ends(name):
    number = getattr(signal, name)
    run = subprocess.Popen(
        SERVE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),  # ignored behind & in scripts
    )
    assert "http://127.0.0.1" in run.stdout.readline()
    run.send_signal(number)
    _, errors = run.communicate(timeout=300)
    assert (run.returncode, errors) == (128 + number, "")


@pytest.mark.slow
def test_a_terminal_that_closes_ends_the_command():
    """Nothing can be written to it, and that is no error."""
    mine, its = pty.openpty()
    run = subprocess.Popen(
        SERVE, stdin=its, stdout=its, stderr=its, start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(its, termios.TIOCSCTTY, 0),
    )  # fmt: skip
    os.close(its)
    output = b""
    while b"Ctrl-C ends" not in output:
        output += os.read(mine, 1000)
    os.close(mine)
    assert run.wait(timeout=300) == 128 + signal.SIGHUP
