"""Sensation level against time: closed forms of tones, bursts and steps, and its honest limits."""

import numpy as np
import pytest

from haptix.model.perception.sensation import SensationInTime
from haptix.model.perception.thresholds import Perception, components_of_pull, detection

RATE = 48_000.0
SUMMATION_S = 0.2


def attraction(amplitude_v, drive_hz, length_s):
    t = np.arange(round(length_s * RATE)) / RATE
    return (amplitude_v * np.sin(2 * np.pi * drive_hz * t)) ** 2 / 2


def loudest(*blocks, rate=RATE):
    level = SensationInTime(Perception.default(), rate)
    for one in blocks:
        level.take(one)
    return level.finish()


# 0.1 dB: the filter rounds the corners of the threshold curve over 16 Hz, and the highest level
# lies on the ripple that is left of the energy.
CLOSE_DB = 0.1


@pytest.mark.parametrize(("drive_hz", "threshold_db"), [(80, 25.8), (120, 24.5), (180, 18.8)])
def test_a_lasting_tone_has_the_level_of_its_component(drive_hz, threshold_db):
    found = loudest(attraction(60.0, drive_hz, 1.5))
    # 1.5 s are 7.5 time constants: 0.003 dB are missing.
    assert found.sensation_db == pytest.approx(20 * np.log10(60) - threshold_db, abs=CLOSE_DB)
    assert found.channel == "pacinian" and 1.0 < found.at_s <= 1.5
    assert found.outside_share < 1e-3


@pytest.mark.parametrize("length_s", [0.05, 0.1, 0.2, 0.4])
def test_a_burst_has_the_energy_that_was_summed(length_s):
    """Zwislocki's form: 1 - exp(-d/T) of the energy; 5 dB are a factor of ten of it."""
    found = loudest(attraction(60.0, 120.0, length_s))
    lost = 5 * np.log10(1 - np.exp(-length_s / SUMMATION_S))
    # A burst's own onset adds some: 0.2 dB at 12 of its periods.
    assert found.sensation_db == pytest.approx(20 * np.log10(60) - 24.5 + lost, abs=0.25)
    assert found.at_s == pytest.approx(length_s, abs=0.01)


def test_it_is_the_highest_and_no_mean():
    quiet, loud = attraction(30.0, 120.0, 1.0), attraction(80.0, 120.0, 1.0)
    found = loudest(quiet, loud, quiet, quiet)
    assert found.sensation_db == pytest.approx(loudest(loud).sensation_db, abs=0.02)
    assert 1.9 < found.at_s < 2.1


def test_blocks_change_nothing():
    whole = attraction(50.0, 133.0, 1.0)
    found = loudest(whole)
    cut = loudest(*np.split(whole, [7, 5000, 5001, 30_000]))
    # Energies are summed every 19 samples of 48 kHz, which begin anew with each block.
    assert cut.sensation_db == pytest.approx(found.sensation_db, abs=0.01)
    # At another rate the same signal is the same.
    t = np.arange(22_050) / 22_050
    other = (50 * np.sin(2 * np.pi * 133 * t)) ** 2 / 2
    assert loudest(other, rate=22_050.0).sensation_db == pytest.approx(found.sensation_db, abs=0.05)


def test_no_jump_anywhere_along_a_sweep():
    """18 dB lay between 159 and 161 Hz; outside the data there is now no level at all."""
    levels = []
    for felt in (165.0, 240.0, 241.0, 500.0, 539.0, 541.0, 795.0):
        levels.append(loudest(attraction(60.0, felt / 2, 0.6)).sensation_db)
        exact = detection(components_of_pull(60 * np.sin(
            np.pi * felt * np.arange(48_000) / RATE), RATE)).sensation_db  # fmt: skip
        assert levels[-1] == pytest.approx(exact, abs=0.15)
    # One hertz is 0.06 dB at the steepest, and the rounded corners are within the 0.15 dB above.
    assert abs(levels[1] - levels[2]) < 0.25 and abs(levels[4] - levels[5]) < 0.25


def test_what_is_not_known_is_said():
    """A tone felt at 60 Hz fades in and out: hardly anything of it has thresholds."""
    fade = np.minimum(1, np.minimum(np.arange(48_000), 47_999 - np.arange(48_000)) / 4800)
    found = loudest(attraction(60.0, 30.0, 1.0) * fade)
    assert found.outside_share > 0.999
    assert found.sensation_db is None or found.sensation_db < -5
    steady = loudest(np.full(48_000, 900.0))
    assert steady.outside_share == 0.0
    nothing = loudest(np.zeros(1000))
    assert (nothing.channel, nothing.sensation_db, nothing.at_s) == (None, None, None)
    assert loudest().sensation_db is None
