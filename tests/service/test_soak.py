"""Half a minute of ten fingers and observers that come and go: memory and descriptors stay.

`python benchmarks/service.py --soak 3600` is the long one.
"""

import os
from pathlib import Path

import pytest

from tests.service.test_processes import LAYOUT, Running
from tests.waiting import pause, wait_for

pytestmark = pytest.mark.slow  # who comes and goes is tested with the sessions, too

SOAK_TURNS, WARM_TURNS = 1500, 500


def held(pid):
    """Resident memory [MB] and descriptors."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6, len([*Path(f"/proc/{pid}/fd").iterdir()])


def plays(service, client, turns):
    for turn in range(turns):
        for finger in range(10):
            client.touch(50.0 + turn % 30, 5.0 * finger + 5, 0.5, touch_id=finger)
        if turn % 50 == 0:
            with service.connect("observer") as observer:
                observer.ask("subscribe", streams={"stats": 50.0})
                client.layout_set(LAYOUT)
        pause(0.01)


def test_memory_is_flat_and_no_descriptor_is_lost(tmp_path):
    service = Running(tmp_path / "service")
    try:
        with service.connect() as client:
            client.layout_set(LAYOUT)
            client.acquire()
            client.arm()
            pids = (service.process.pid, service.engine)
            # The spare that starts some seconds after arming takes descriptors of the front.
            helpers = len(service.helpers)
            wait_for(lambda: len(service.helpers) > helpers)
            pause(0.5)  # its pipes are read from then on
            counts = [held(pid)[1] for pid in pids]  # while there is no observer
            plays(service, client, WARM_TURNS)
            before = [held(pid)[0] for pid in pids]
            plays(service, client, SOAK_TURNS)
            # The front closes an observer's socket in its own time.
            wait_for(lambda: [held(pid)[1] for pid in pids] == counts)
            for pid, memory in zip(pids, before, strict=True):
                # The bound of an hour: pools still fill in twenty seconds.
                assert held(pid)[0] - memory < 10.0
    finally:
        service.close()
