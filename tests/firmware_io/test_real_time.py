"""Priorities and wake-ups: nothing is asserted of how fast this machine is."""

import os
import sys
import threading
from types import SimpleNamespace

import pytest

from firmware_io.clock import measure_wake_ups, raise_priority


def policy_after(raise_it):
    """Scheduling of a thread that asked for priority, and of a thread that it started."""
    found = []

    def child():
        found.append(os.sched_getscheduler(0))

    def run():
        raised = raise_it()
        found.append(raised)
        found.append(os.sched_getscheduler(0))
        thread = threading.Thread(target=child)
        thread.start()
        thread.join()

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="SCHED_FIFO is Linux's")
def test_only_the_thread_that_asks_gets_priority():
    before = os.sched_getscheduler(0)
    raised, own, of_child = policy_after(raise_priority)
    assert (own & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO) == raised
    assert of_child == os.SCHED_OTHER
    assert os.sched_getscheduler(0) == before


def test_without_the_right_nothing_changes(monkeypatch):
    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse, raising=False)
    assert raise_priority() is False
    assert not measure_wake_ups(0.01).is_real_time


def test_wake_ups_are_counted_from_when_they_were_due(monkeypatch):
    times = iter(t / 100 for t in range(100))  # each look at the clock takes 10 ms
    # This module's clock only: other threads of the process read the real one.
    clock = SimpleNamespace(monotonic=lambda: next(times))
    monkeypatch.setattr("firmware_io.clock.time", clock)
    found = measure_wake_ups(0.1)
    # Due 3 ms after the look before.
    assert [found.p50_s, found.p99_s, found.largest_s] == pytest.approx([0.007] * 3)
