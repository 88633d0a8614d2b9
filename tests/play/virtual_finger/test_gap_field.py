"""The squared field in every gap from a few points, against the field in each."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix.base.errors import InputError
from haptix.play.virtual_finger.squared_field import GapField, Samples

EPS0 = 8.8541878128e-12
RATE, COUNT = 48_000.0, 4800
GAPS = np.concatenate([[0.0], np.geomspace(1e-10, 1e-3, 29)])


def layered(frequency_hz, eps=2000.0, rho=1e5):
    """1 um of SiO2 and 200 um of skin with constants: exp(-i w t), as the physics page has it."""
    steady = frequency_hz == 0
    at = np.where(steady, 1.0, frequency_hz)
    skin = 2e-4 / (eps + 1j / (2 * np.pi * at * EPS0 * rho))
    return np.where(steady, 0.0, skin) + 1.25e-7 + 0j


def leaky(frequency_hz, rho=1e6):
    steady = frequency_hz == 0
    at = np.where(steady, 1.0, frequency_hz)
    return np.where(steady, 1e6, (1 + 1j / (2 * np.pi * at * EPS0 * rho)) * layered(at))


def direct(volts, thickness_m, gap_m):
    """Field in one gap, harmonic by harmonic, for a drive that is one period: its own DFT."""
    time = np.arange(len(volts)) / RATE
    field = np.zeros(len(volts))
    spectrum = np.fft.fft(volts) / len(volts)
    for k in np.flatnonzero(np.abs(spectrum) > 1e-9):
        frequency = np.fft.fftfreq(len(volts), 1 / RATE)[k]
        # exp(+i w t) has the conjugate thickness, a negative frequency that of the positive one.
        h0 = thickness_m(np.array([abs(frequency)]))[0]
        h0 = h0.conj() if frequency >= 0 else h0
        field += (spectrum[k] * np.exp(2j * np.pi * frequency * time) / (gap_m + h0)).real
    return field


tones = st.lists(
    st.tuples(st.integers(1, 1200), st.floats(1, 60), st.floats(0, 6.28)), min_size=1, max_size=5
)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(tones=tones, thickness=st.sampled_from([layered, leaky]))
def test_the_points_hold_the_pull_on_every_gap(tones, thickness):
    """Tones of 10 Hz to 12 kHz in steps of 10 Hz: 0.1 s is a period of every mixture."""
    time = np.arange(COUNT) / RATE
    volts = sum(v * np.cos(2 * np.pi * 10 * k * time + phase) for k, v, phase in tones)
    played = Samples(np.tile(volts, 12), RATE, 0.0, thickness)
    field = played.field(1e-3)
    at = np.arange(20, COUNT, 97)
    t = 0.5 + time[at]
    squares = played.excerpt(float(t[0]), float(t[-1])).squares(field, t, 1e9)
    pulls = (field.basis_of_gaps(GAPS).T @ squares) / (GAPS[:, None] + field.reference_m) ** 2
    expected = np.stack([direct(volts, thickness, gap)[at] ** 2 for gap in GAPS])
    # 1e-4 of the pull at a contact spot for the polynomial, and straight lines at 96 kHz.
    scale = max(np.max(direct(volts, thickness, 0.0) ** 2), 1e-30)
    assert np.abs(pulls - expected).max() < 1e-3 * scale


def test_a_gap_that_leaks_is_pulled_while_a_steady_voltage_comes_on_and_no_longer():
    played = Samples(np.full(48_000, 100.0), RATE, 0.0, leaky)
    field = played.field(1e-3)
    t = np.array([1e-4, 0.5])
    squares = played.excerpt(0.0, 0.5).squares(field, t, 1e9)
    spot = (field.basis_of_gaps(np.zeros(1)).T @ squares)[0] / field.reference_m**2
    # At once the capacitances alone divide it: skin of 200 um / 2000 and SiO2 of 1 um / 8; what
    # leaks takes eps0 rho_g = 9 us for a gap of zero, so that 0.1 ms later exp(-11) is left.
    at_once = (100.0 / 2.25e-7) ** 2
    assert spot[1] < 1e-6 * at_once
    wide = field.basis_of_gaps(np.array([1e-5])).T @ squares / (1e-5 + field.reference_m) ** 2
    # A gap of 10 um takes 45 times as long: exp(-0.1 ms / 0.41 ms).
    assert wide[0, 0] == pytest.approx((100.0 / 1.0225e-5 * np.exp(-0.1 / 0.41)) ** 2, rel=0.05)


def test_without_dispersion_one_point_is_exact():
    volts = np.random.default_rng(1).normal(size=4800)
    field = GapField.for_drive(volts, RATE, lambda f: np.full(len(f), 2e-7 + 0j), 1e-3)
    assert field.points == 1
    assert field.reference_m == pytest.approx(2e-7, rel=1e-12)
    assert GapField.for_drive(np.zeros(100), RATE, layered, 1e-3).points == 1


def test_a_narrow_band_needs_few_points():
    time = np.arange(48_000) / RATE
    carrier = (1 + 0.5 * np.sin(2 * np.pi * 50 * time)) * np.sin(2 * np.pi * 4000 * time)
    assert GapField.for_drive(carrier, RATE, layered, 1e-3).points <= 4


def test_insulators_of_no_common_scale_are_refused():
    with pytest.raises(InputError, match="similar insulators"):
        GapField.for_bands(np.array([1e-7, -1e-7 + 1e-12j]), np.ones(2), 1e-3)


@pytest.mark.parametrize("rate", [8000.0, 44_100.0, 48_000.0, 192_000.0])
def test_the_square_of_a_high_tone_does_not_fold_back(rate):
    """A tone near half the sample rate: its square has a mean and, past the band, nothing."""
    time = np.arange(int(rate)) / rate
    sine = np.sin(2 * np.pi * 0.46 * rate * time)
    played = Samples(sine, rate, 0.0, lambda f: np.full(f.shape, 2e-7 + 0j))
    t = np.linspace(0.45, 0.55, 101)
    squares = played.excerpt(0.45, 0.55).squares(played.field(1e-3), t, 2500.0)
    # The tone ends at once, 0.45 s away: k samples from there 1/(pi k) of it are left, and a square
    # has twice that.
    np.testing.assert_allclose(squares[0], 0.5, rtol=4 / (np.pi * 0.45 * rate))
