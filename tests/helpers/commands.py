"""Commands of spacearm, run in processes of their own."""

import json
import os
import subprocess
import sys


def spacearm(*words, **environment):
    command = [sys.executable, "-m", "spacearm", *map(str, words)]
    env = os.environ | {"COLUMNS": "100", "NO_COLOR": "1"} | environment
    return subprocess.run(command, capture_output=True, text=True, env=env, timeout=60, check=False)


def answer(*words):
    run = spacearm(*words, "--json")
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)
