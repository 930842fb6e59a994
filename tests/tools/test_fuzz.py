"""Fuzzing in its short form (`fuzz.py` runs longer ones); what longer ones found is tested with the
module that it was in."""

import re
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hostile import urdf
from hostile_files import studies

import spacearm as sa

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the fence reads /proc")
FUZZ = Path(__file__).with_name("fuzz.py")
CASES = {
    "calls": 250, "commands": 30, "tables": 30, "urdf": 60, "formats": 100, "names": 30,
    "motions": 25, "studies": 100, "stores": 15, "trajectories": 40, "meshes": 80, "messages": 8,
}  # fmt: skip
"""Cases of each target, at most."""
SECONDS = 13
"""Time after which a target takes no further case [s]."""
SAMPLE = 20
"""Cases of the fast tier, of targets that compile nothing."""


def fuzzed(*words):
    """What the fuzzer prints; it must find nothing."""
    words = [sys.executable, str(FUZZ), *map(str, words)]
    run = subprocess.run(words, capture_output=True, text=True, check=False, timeout=600)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


@pytest.mark.slow
@pytest.mark.parametrize("target", CASES)
def test_hostile_input_gives_a_result_or_one_error(target):
    said = fuzzed(target, CASES[target], "--seconds", SECONDS)
    assert re.search(rf"^{target}: [1-9]\d* cases, seed 0: .* 0 faults", said, re.MULTILINE)


@pytest.mark.filterwarnings("ignore::spacearm.ModelWarning")
@pytest.mark.parametrize("target", [urdf, studies], ids=lambda target: target.__name__)
def test_a_sample_of_hostile_files_gives_a_result_or_one_error(target, tmp_path, monkeypatch):
    """Without the fence, in this process."""
    monkeypatch.chdir(tmp_path)
    for number in range(SAMPLE):
        with suppress(sa.SpaceArmError):
            target(np.random.default_rng([1, number]), tmp_path, set())


def test_every_target_is_run():
    assert set(CASES) == set(re.findall(r'^    "(\w+)": \w+,$', FUZZ.read_text(), re.MULTILINE))


FAULTS = {
    "open('/dev/full', 'w').close()": "open /dev/full",
    "open('../escaped.txt', 'w').close()": "open /",
    "open(f'{folder}x', 'w').close()": "open /",
    "open('unnamed.txt', 'w').close()": "left or took away unnamed.txt",
    "os.close(os.open('../made.txt', os.O_CREAT | os.O_WRONLY))": "open /",
    "(open('a', 'w').close(), os.rename('a', '../a'))": "os.rename /",
    "os.remove('../kept')": "os.remove /",
    "os.truncate('../kept', 0)": "os.truncate /",
    "os.chmod('../kept', 0)": "os.chmod /",
    "os.utime('../kept')": "os.utime /",
    "os.mkdir('../made')": "os.mkdir /",
    "os.rmdir(os.pardir + '/kept')": "os.rmdir /",
    "os.symlink('kept', '../link')": "os.symlink /",
    "os.link('/etc/passwd', 'link')": "os.link /etc/passwd",
    "os.mkfifo('../pipe')": "left or took away ../pipe",
    "xml.write('unnamed.xml')": "left or took away unnamed.xml",
    "xml.write('../unnamed.xml')": "left or took away ../unnamed.xml",
    "socket.socket().connect(('192.0.2.1', 9))": "socket.connect ('192.0.2.1', 9)",
    "socket.socket().connect_ex(('127.0.0.1', 9))": "socket.connect ('127.0.0.1', 9)",
    "socket.socket(type=socket.SOCK_DGRAM).sendto(b'', ('192.0.2.1', 9))": "socket.sendto",
    "socket.socket().bind(('0.0.0.0', 0))": "socket.bind ('0.0.0.0', 0)",
    "socket.getaddrinfo('localhost', 80)": "socket.getaddrinfo localhost",
    "socket.gethostbyname('localhost')": "socket.gethostbyname",
    "__import__('urllib.request').request.urlopen('file:///etc/passwd')": "urllib.Request",
    "__import__('subprocess').run('true')": "subprocess.Popen",
    "os.waitpid(os.fork() or os._exit(0), 0)": "os.fork",
    "os.posix_spawn('/bin/true', ['true'], {})": "os.posix_spawn",
    "os.spawnv(os.P_WAIT, '/bin/true', ['true'])": "os.fork",
    "os.system('true')": "os.system",
    "os.kill(os.getpid(), 0)": "os.kill",
    "[0 for _ in iter(int, 1)]": "Hang: the case took too long",
    "time.sleep(6)": "Hang: the case took too long",
    "__import__('threading').Event().wait()": "Hang: the case took too long",
    "bytes(fuzz.MEMORY)": "MemoryError",
    "1 / 0": "ZeroDivisionError",
    "warnings.warn('deprecated')": "UserWarning: deprecated",
}


@pytest.mark.slow
def test_the_fence_sees_what_must_not_be():
    code = (
        "import sys; sys.path.insert(0, sys.argv.pop(1)); import fuzz, fence, os, socket, time\n"
        "from lxml import etree; xml = etree.ElementTree(etree.XML('<a/>'))\n"
        f"fuzz.LIMIT, faults = 2.0, iter({list(FAULTS)!r})\n"
        "def misbehave(rng, folder, named):\n"
        "    fault = next(faults)\n"
        "    eval(fault, {**vars(fuzz), **globals(), 'folder': folder})\n"
        "fuzz.TARGETS['urdf'] = misbehave\n"
        "sys.exit(fuzz.main())"
    )
    words = [sys.executable, "-c", code, str(FUZZ.parent), "urdf", str(len(FAULTS))]
    run = subprocess.run(words, capture_output=True, text=True, check=False, timeout=600)
    assert run.returncode == 1, run.stdout + run.stderr
    assert f"0 accepted, 0 refused, {len(FAULTS)} faults" in run.stdout
    for number, what in enumerate(FAULTS.values()):
        said = re.findall(rf"^urdf case {number}, (.*?)(?=^urdf)", run.stdout, re.M | re.S)
        assert what in "".join(said), (number, what, run.stdout)
