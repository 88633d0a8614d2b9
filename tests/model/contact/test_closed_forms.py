"""The closed forms against their own integrals, balances and published limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from haptix.base.errors import InputError
from tests.model.contact.closed_forms import (
    HertzSphere,
    WavySurface,
    crossed_waves_full_contact_pressure,
)

lengths = st.floats(-9, 0).map(lambda e: 10**e)
moduli = st.floats(3, 12).map(lambda e: 10**e)
EXACT = 1e-7  # quadrature towards the root at the contact's border


@given(lengths, moduli, st.floats(-6, 2).map(lambda e: 10**e))
def test_hertz_pressure_carries_the_force(radius: float, modulus: float, force: float) -> None:
    sphere = HertzSphere(radius, modulus)
    a = float(sphere.contact_radius_m(force))
    ring = 2 * np.pi * a * a / force
    total = quad(lambda t: ring * t * float(sphere.pressure_pa(force, t * a)), 0, 1)[0]
    assert total == pytest.approx(1, rel=EXACT)
    # Johnson (1985), eq. 4.23 and 4.24, in their other form with the force cubed.
    assert sphere.indentation_m(force) == pytest.approx(
        (9 * force**2 / (16 * radius * modulus**2)) ** (1 / 3), rel=EXACT
    )
    assert sphere.peak_pressure_pa(force) == pytest.approx(
        (6 * force * modulus**2 / (np.pi**3 * radius**2)) ** (1 / 3), rel=EXACT
    )


@given(lengths, lengths, moduli, st.floats(0.001, 0.999))
def test_westergaard_pressure_carries_the_load(
    amplitude: float, wavelength: float, modulus: float, share: float
) -> None:
    wave = WavySurface(amplitude, wavelength, modulus)
    mean = share * wave.full_contact_pressure_pa
    half = float(wave.contact_fraction(mean)) * wavelength / 2
    width = 2 * half / wavelength / mean
    total = quad(lambda t: width * float(wave.pressure_pa(mean, t * half)), 0, 1)[0]
    assert total == pytest.approx(1, rel=EXACT)
    assert wave.mean_pressure_pa(wave.contact_fraction(mean)) == pytest.approx(mean, rel=EXACT)


def test_westergaard_at_light_load_is_hertz_on_a_line() -> None:
    # Crest radius lambda^2 / (4 pi^2 amplitude); half-width sqrt(4 F R / pi E*) (Johnson, 4.43).
    wave, load = WavySurface(1e-6, 1e-4, 1e8), 1e-6
    per_length = load * wave.full_contact_pressure_pa * wave.wavelength_m
    radius = wave.wavelength_m**2 / (4 * np.pi**2 * wave.amplitude_m)
    half = np.sqrt(4 * per_length * radius / (np.pi * wave.modulus_pa))
    found = wave.contact_fraction(load * wave.full_contact_pressure_pa) * wave.wavelength_m / 2
    assert found == pytest.approx(half, rel=load)  # the next term is a sixth of the load's share


def test_full_contact_of_a_single_wave() -> None:
    wave = WavySurface(2e-6, 1e-4, 1e8)
    assert wave.contact_fraction(wave.full_contact_pressure_pa) == 1
    assert wave.contact_fraction(2 * wave.full_contact_pressure_pa) == 1
    assert wave.contact_fraction(0.0) == 0
    # The same wave rotated by 45 degrees is one of sqrt(2) of the wavenumber.
    crossed = crossed_waves_full_contact_pressure(2e-6, 1e-4, 1e8)
    assert crossed == pytest.approx(2**0.5 * wave.full_contact_pressure_pa, rel=EXACT)


def test_impossible_numbers_are_refused() -> None:
    with pytest.raises(InputError, match="radius_m"):
        HertzSphere(0.0, 1.0)
    with pytest.raises(InputError, match="force_n"):
        HertzSphere(1.0, 1.0).contact_radius_m(-1.0)
    with pytest.raises(InputError, match="wavelength_m"):
        WavySurface(1.0, float("nan"), 1.0)
    with pytest.raises(InputError, match="contact_fraction"):
        WavySurface(1.0, 1.0, 1.0).mean_pressure_pa(1.5)
    with pytest.raises(InputError, match="modulus_pa"):
        crossed_waves_full_contact_pressure(1.0, 1.0, -1.0)
