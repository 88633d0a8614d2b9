"""The virtual finger's process: killed and hung, it is started again and feels on."""

import asyncio
import os
import signal
import time

import numpy as np
import pytest

from haptix.play.touch.events import TouchEvent
from haptix.service.front.engine_process import FeltFingerProcess
from haptix.service.protocol.batches import read_frame
from haptix.service.protocol.wire import amplitude_frame, touch_frame
from tests.waiting import PATIENCE_S

pytestmark = pytest.mark.slow  # loads torch three times

STEP_S = 1 / 12_000
OPENING = {"finger": "semi-wet", "screen": "3m-sct3250", "carrier_hz": 4000.0}


def test_a_twin_that_dies_or_hangs_is_started_again():
    asyncio.run(scenario())


async def scenario():
    events, frames = [], []
    finger = FeltFingerProcess(events.append, frames.append)
    finger.feed(amplitude_frame(0.0, 1e-3, np.zeros(3)))  # there is none yet: nothing happens
    finger.want(True)
    try:
        while finger.pid is None:  # it imports before it is known what it feels
            await asyncio.sleep(0.01)
        finger.opens(OPENING)
        for end in (signal.SIGKILL, signal.SIGSTOP, None):
            await feels(finger, frames)
            pid = finger.pid
            if end is not None:
                os.kill(pid, end)
                # More than in life, so that a finger that does not read is noticed soon.
                await feeds(finger, lambda pid=pid: finger.pid not in (None, pid), copies=50)
    finally:
        finger.kill()
        await finger.stop()
    assert finger.pid is None
    told = [event["sentence"] for event in events]
    assert ["code -9" in told[0], "hung" in told[1], len(told)] == [True, True, 2]


async def feels(finger, frames):
    """Slide until something is felt."""
    frames.clear()
    await feeds(finger, lambda: len(frames) > 2)
    felt = read_frame(frames[-1])
    assert (felt.stream, felt.touch_id) == ("felt", 5)
    assert np.isfinite(felt.rows[:, 0]).any()


async def feeds(finger, is_over, copies=1):
    """Play a steady amplitude under a finger that slides, until something is so."""
    now_s = played_s = began_s = time.monotonic()
    while not is_over():
        assert now_s < began_s + PATIENCE_S, "it did not happen"
        x_mm = 25 + 20 * np.sin(4 * (now_s - began_s))
        finger.feed(touch_frame([TouchEvent(now_s, 5, x_mm, 5.0, "move", 0.5, None)]))
        now_s = time.monotonic()
        points = int((now_s - played_s) / STEP_S)
        finger.feed(amplitude_frame(played_s, STEP_S, np.full(points, 90.0)) * copies)
        played_s += points * STEP_S
        await asyncio.sleep(0.01)
