"""Fuzzing in its short form (`fuzz.py` runs longer ones); what longer ones found is tested with the
module that it was in."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the fence reads /proc")
FUZZ = Path(__file__).with_name("fuzz.py")
CASES = {
    "calls": 300,
    "urdf": 100, "motions": 50, "commands": 40, "studies": 100, "stores": 20, "trajectories": 60,
    "meshes": 100, "messages": 15,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("target", CASES)
def test_hostile_input_gives_a_result_or_one_error(target):
    words = [sys.executable, str(FUZZ), target, str(CASES[target])]
    run = subprocess.run(words, capture_output=True, text=True, check=False, timeout=600)
    assert run.returncode == 0, run.stdout + run.stderr
    assert f"{target}: {CASES[target]} cases, seed 0: " in run.stdout


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
