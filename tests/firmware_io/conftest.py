import threading

import pytest

from tests.firmware_io.core_rig import Rig
from tests.hand_clock import HandClock


@pytest.fixture
def clock():
    return HandClock()


@pytest.fixture
def no_thread_is_left():
    before = set(threading.enumerate())
    yield
    assert set(threading.enumerate()) <= before


@pytest.fixture
def rig():
    """A core on the bench."""
    return Rig()
