"""However a program ends, an audio interface ends in a ramp: measured in JACK's samples."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.devices.jack_session import jack_session, missing

pytestmark = pytest.mark.devices

FULL_SCALE_V = 200.0
#: The sine's own steepest step at 48 kHz and a ramp's of 5 ms, which come together where a machine
#: that stalls lets the samples run out and the signal fade in again; and rounding. 2.1 V of 173 V.
STEEPEST_STEP_V = (2 * np.pi * 60 * 173.0 + 173.0 / 0.005) / 48_000 + 0.02


def heard_at_the_end(folder, way):
    # Of these two nothing tells JACK that they have ended: it waits for them, cycle by cycle.
    client_timeout_ms = 1000 if way in ("link", "SIGKILL") else 5000
    with jack_session(folder, client_timeout_ms) as hearing:
        program = str(Path(__file__).parent / "audio_ending.py")
        address = f"audio:device=cap,full_scale_v={FULL_SCALE_V}"
        command = [sys.executable, program, address, way]
        subprocess.run(command, env=hearing.environment, capture_output=True, timeout=300)
    return hearing.samples[0] * FULL_SCALE_V


@pytest.mark.parametrize("way", ["stop", "close", "link", "error", "exit", "SIGTERM"])
def test_the_output_ends_in_a_ramp(tmp_path, way):
    if missing():
        pytest.skip(f"missing: {missing()}")
    volts = heard_at_the_end(tmp_path, way)
    assert np.abs(volts).max() > 160.0
    assert np.abs(np.diff(volts)).max() <= STEEPEST_STEP_V
    # Nothing is left on the interface.
    assert not volts[np.flatnonzero(volts)[-1] + 1 :].any()


def test_a_killed_program_leaves_silence_on_jack(tmp_path):
    if missing():
        pytest.skip(f"missing: {missing()}")
    volts = heard_at_the_end(tmp_path, "SIGKILL")
    assert np.abs(volts).max() > 160.0
    # JACK drops the client with its cycle of 480 samples: a step, and then nothing.
    after = volts[np.flatnonzero(volts)[-1] + 1 :]
    assert after.size >= 480
