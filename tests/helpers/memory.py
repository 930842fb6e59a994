"""Programs that run in a process with little memory, so that one that takes too much fails."""

from __future__ import annotations

import os
import subprocess
import sys

BEGIN = """
import resource, warnings
warnings.simplefilter("ignore")
resource.setrlimit(resource.RLIMIT_AS, ({0}, {0}))
import spacearm as sa
"""
#: Prints the largest memory of the process [MB]. On Linux `ru_maxrss` begins with that of the
#: process that was forked, `VmHWM` does not.
END = """
import sys
from pathlib import Path
if sys.platform == "linux":
    status = Path("/proc/self/status").read_text().split()
    print(int(status[status.index("VmHWM:") + 1]) // 1024)
else:
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 2**20)
"""


def run_within(gigabytes: float, program: str, **environment: str) -> tuple[str, int]:
    """Run a program with a limit of address space; `sa` is imported.

    Returns:
        What it printed, and the largest memory that it had [MB].
    """
    text = BEGIN.format(int(gigabytes * 1e9)) + program + END
    done = subprocess.run(
        [sys.executable, "-c", text],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **environment},
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    *lines, peak = done.stdout.splitlines()
    return "\n".join(lines), int(peak)
