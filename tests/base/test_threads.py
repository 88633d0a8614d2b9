"""What threads of a process keep, and give back."""

import subprocess
import sys

import pytest

PROGRAM = """
import threading
from pathlib import Path

import numpy as np

from haptix.base.threads import keep_freed_memory, return_freed_memory

kept = []


def used_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


def build():
    arrays = []
    for number in range(200):  # 40 MB of arrays as small as those of tables
        arrays.append(np.ones(25_000))
        if number == KEPT:
            kept.append(np.ones(1000))
    before = used_mb()
    del arrays
    return_freed_memory()
    print(before - used_mb())


keep_freed_memory()
thread = threading.Thread(target=build)
thread.start()
thread.join()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc alone keeps freed memory")
@pytest.mark.parametrize("number", [20, pytest.param(199, marks=pytest.mark.slow)])
def test_a_thread_gives_the_kernel_what_it_has_freed(number):
    """What is freed lies behind an array that is kept, or before it."""
    program = PROGRAM.replace("KEPT", str(number))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert float(done.stdout) > 36, done.stderr  # of 40 MB; some pages hold other values, too
