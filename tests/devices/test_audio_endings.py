"""However a program ends, an audio interface ends in a ramp: measured in JACK's samples."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.devices.jack_session import jack_session, missing
from tests.waiting import wait_for

pytestmark = pytest.mark.devices

FULL_SCALE_V = 200.0
#: The sine's own steepest step at 48 kHz and a ramp's of 5 ms, which come together where a machine
#: that stalls lets the samples run out and the signal fade in again; and rounding. 2.1 V of 173 V.
STEEPEST_STEP_V = (2 * np.pi * 60 * 173.0 + 173.0 / 0.005) / 48_000 + 0.02


def heard_at_the_end(folder, way):
    with jack_session(folder) as hearing:
        player = str(Path(__file__).parent / "audio_ending.py")
        address = f"audio:device=cap,full_scale_v={FULL_SCALE_V}"
        command = [sys.executable, player, address, way]
        program = subprocess.Popen(command, env=hearing.environment, start_new_session=True)
        program.wait(300)
        wait_for(lambda: not is_alive(program.pid))  # the interface's own process
    return hearing.samples[0] * FULL_SCALE_V


def is_alive(group):
    """Whether any process of a group is."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("way", ["stop", "close", "link", "error", "exit", "SIGTERM", "SIGKILL"])
def test_the_output_ends_in_a_ramp(tmp_path, way):
    if missing():
        pytest.skip(f"missing: {missing()}")
    volts = heard_at_the_end(tmp_path, way)
    assert np.abs(volts).max() > 160.0
    assert np.abs(np.diff(volts)).max() <= STEEPEST_STEP_V
    # Nothing is left on the interface.
    assert not volts[np.flatnonzero(volts)[-1] + 1 :].any()
