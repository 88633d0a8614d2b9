"""What a sidecar says of sound, against closed forms of sines."""

import numpy as np
import pytest

from haptix.lab.stimuli.rendering import Block
from haptix.lab.stimuli.sidecar import a_weighting_db, heard
from haptix.model.perception.thresholds import Perception

RATE, KNOWN, FARAD = 48_000.0, Perception.default().audibility, 1e-9
T = np.arange(24_000) / RATE


def look(drive, instant=None, **given):
    size = np.abs(drive) if instant is None else instant
    return heard(Block(0, drive, size, size, size, 0.0, 0.0, 0, 0), RATE, FARAD, KNOWN, **given)


@pytest.mark.parametrize(
    ("hz", "db"),
    [(20, -50.5), (31.5, -39.4), (63, -26.2), (100, -19.1), (250, -8.6), (500, -3.2), (1000, 0.0),
     (2000, 1.2), (4000, 1.0), (8000, -1.1), (16000, -6.6), (20000, -9.3)],
)  # fmt: skip
def test_a_weighting_is_the_standards(hz, db):
    """IEC 61672-1, table 3, whose nominal frequencies are up to 2 % off the exact ones."""
    assert a_weighting_db(np.array([hz]))[0] == pytest.approx(db, abs=0.15)


def test_a_carrier_with_a_moving_amplitude():
    amplitude = 100 * (1 + 0.5 * np.sin(2 * np.pi * 100 * T))
    found = look(amplitude * np.sin(2 * np.pi * 4000 * T), amplitude)
    assert (found["drive_hz"], found["envelope_hz"]) == (4000.0, 100.0)
    # 2 pi f C V / sqrt(2), of the carrier's 100 V; its side lines lie within A-weighting's 0.1 dB.
    assert found["drive_current_a_rms"] == pytest.approx(
        2 * np.pi * 4000 * FARAD * 100 / np.sqrt(2), rel=1e-3
    )
    assert found["drive_a_weighted_db"] == pytest.approx(1.0, abs=0.1)
    # a^2 moves as sin at 100 Hz, and by an eighth as much at 200 Hz: -19.1 and -10.9 dB.
    weights = 10 ** (a_weighting_db(np.array([100.0, 200.0])) / 10)
    energies = np.array([1.0, 1 / 64])
    expected = 10 * np.log10((weights * energies).sum() / energies.sum())
    assert found["envelope_a_weighted_db"] == pytest.approx(expected, abs=0.1)
    assert found["drive_share_in_range"] == pytest.approx(1.0)
    assert found["audible"] and "8000 Hz over closed headphones" in found["advice"]
    assert "dB SPL" not in str(found) and "not known" in found["emission"]


def test_what_lies_out_of_range_is_no_share():
    found = look(50 * np.sin(2 * np.pi * 10 * T) + 50 * np.sin(2 * np.pi * 2000 * T))
    # Half of the energy at 10 Hz; a window's skirt of 10 Hz reaches to 14.
    assert found["drive_share_in_range"] == pytest.approx(0.5, rel=1e-3)


def test_nothing_and_little_are_not_flagged():
    for drive in (np.zeros(2400), 1e-3 * np.sin(2 * np.pi * 4000 * T), np.ones(1)):
        found = look(drive)
        assert not found["audible"] and found["advice"].startswith("not flagged")


def test_a_spectrum_that_is_known_changes_nothing():
    amplitude = 100 * (1 + 0.5 * np.sin(2 * np.pi * 100 * T))
    drive = amplitude * np.sin(2 * np.pi * 4000 * T)
    attraction = amplitude**2 / 4
    window = np.hanning(T.size + 2)[1:-1]
    changes = np.abs(np.fft.rfft((attraction - attraction.mean()) * window)) ** 2
    plain, shared = look(drive, amplitude), look(drive, amplitude, changes=changes)
    for name, value in plain.items():
        same = value if isinstance(value, str) else pytest.approx(value, rel=1e-9)
        assert shared[name] == same, name
