"""Half a minute of ten fingers and observers that come and go: memory and descriptors stay.

`python benchmarks/service.py --soak 3600` is the long one.
"""

import os
import time
from pathlib import Path

import pytest

from tests.service.test_processes import LAYOUT, Running

pytestmark = pytest.mark.slow  # who comes and goes is tested with the sessions, too

SOAK_S, WARM_S = 20.0, 8.0


def held(pid):
    """Resident memory [MB] and descriptors."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6, len([*Path(f"/proc/{pid}/fd").iterdir()])


def plays(service, client, seconds):
    end_s, turn = time.monotonic() + seconds, 0
    while time.monotonic() < end_s:
        for finger in range(10):
            client.touch(50.0 + turn % 30, 5.0 * finger + 5, 0.5, touch_id=finger)
        if turn % 50 == 0:
            with service.connect("observer") as observer:
                observer.ask("subscribe", streams={"stats": 50.0})
                client.layout_set(LAYOUT)
        turn += 1
        time.sleep(0.01)


def test_memory_is_flat_and_no_descriptor_is_lost(tmp_path):
    service = Running(tmp_path / "service")
    try:
        with service.connect() as client:
            client.layout_set(LAYOUT)
            client.acquire()
            client.arm()
            plays(service, client, WARM_S)
            time.sleep(0.5)
            pids = (service.process.pid, service.engine)
            before = [held(pid) for pid in pids]
            plays(service, client, SOAK_S)
            time.sleep(0.5)
            after = [held(pid) for pid in pids]
        for (memory, count), (memory_then, count_then) in zip(before, after, strict=True):
            # The bound of an hour: pools still fill in twenty seconds.
            assert memory_then - memory < 10.0
            assert count_then == count
    finally:
        service.close()
