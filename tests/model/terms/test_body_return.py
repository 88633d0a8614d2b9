"""The body's return to earth: closed forms of a flat contact, limits, and every kind of drive."""

from math import pi

import numpy as np
import pytest
import torch

from calibration import Parameters, StrokePredictor
from calibration.plan.predict import StrokeConditions
from firmware_io.limits import BODY_CAPACITANCE_F
from haptix import ContactModel, Finger, Screen, Status
from haptix.base.errors import InputError
from haptix.model.electro import VACUUM_PERMITTIVITY
from haptix.play.virtual_finger import VirtualFinger

FINGER, SCREEN = Finger(name="gel"), Screen()
ON = {"body-return": True}


def fraction_left(contact: complex, fingers: int, body: float) -> float:
    """Two capacitors in series."""
    return abs(body / (body + fingers * contact))


@pytest.mark.parametrize("body", [50e-12, 150e-12, 1e-9])
@pytest.mark.parametrize("fingers", [1, 2])
def test_two_capacitors_in_series(body: float, fingers: int) -> None:
    finger = FINGER.replace(fingers_on_screen=fingers)
    model = ContactModel(finger, SCREEN.replace(body_capacitance_f=body), terms=ON)
    plain = ContactModel(finger, SCREEN)
    voltage = torch.tensor([20.0, 100.0, 200.0], dtype=torch.float64)
    state = model.solve(0.5, voltage, 200.0)
    angular = 2 * pi * 200.0
    contact = torch.complex(state.capacitance_f, state.conductance_s / angular)
    left = (body / (body + fingers * contact)).abs()
    # The state is that of a contact without a body under the voltage that is left. Its gaps are
    # read by lines between nodes 10 % apart in pressure: 2e-4 of the voltage.
    same = plain.solve(0.5, voltage * left, 200.0)
    torch.testing.assert_close(state.mu, same.mu, rtol=3e-4, atol=0)
    torch.testing.assert_close(state.peak_field_v_per_m, same.peak_field_v_per_m, rtol=3e-4, atol=0)
    assert state.current_a is not None
    series = contact * body / (body + fingers * contact)
    expected = angular * voltage * series.abs()
    torch.testing.assert_close(state.current_a, expected, rtol=3e-4, atol=0)
    assert bool((state.mu < plain.solve(0.5, voltage, 200.0).mu).all())


def test_a_finger_keeps_nine_tenths_and_two_fingers_eight() -> None:
    # The physics page: 0.88 to 0.92 of the voltage for one finger, 0.79 to 0.85 for two, of 14 pF
    # each; the preset's has 15 pF by the theory of those numbers.
    for fingers, low, high in ((1, 0.86, 0.93), (2, 0.76, 0.87)):
        finger = Finger.preset("semi-wet").replace(fingers_on_screen=fingers)
        plain = ContactModel(finger, SCREEN, theory="open-gaps").solve(0.5, 0.0, 4000.0)
        for body in (100e-12, 150e-12):
            screen = SCREEN.replace(body_capacitance_f=body)
            model = ContactModel(finger, screen, terms=ON, theory="open-gaps")
            state = model.solve(0.5, 1.0, 4000.0)
            left = float(plain.breakdown_voltage_v / state.breakdown_voltage_v)
            assert low < left < high


def test_an_earthed_body_changes_nothing() -> None:
    earthed = SCREEN.replace(body_capacitance_f=1.0)
    for spots in ("excluded", "included"):
        on, off = (
            ContactModel(FINGER, earthed, terms={"body-return": term}, contact_spots=spots)
            for term in (True, False)
        )
        inputs = torch.tensor([0.1, 1.0]), torch.tensor([[0.0], [150.0]]), 1e3
        one, other = on.solve(*inputs), off.solve(*inputs)
        # C_c / C_b = 1e-10, and rounding of the table's logarithms
        torch.testing.assert_close(one.mu, other.mu, rtol=1e-8, atol=0)
        pull_in = one.pull_in_voltage_v, other.pull_in_voltage_v
        torch.testing.assert_close(*pull_in, rtol=1e-6, atol=0)


@pytest.mark.parametrize("spots", ["excluded", "included"])
@pytest.mark.parametrize("more", [{}, {"finite-size": True}])
def test_pull_in_is_where_the_status_turns(spots: str, more: dict[str, bool]) -> None:
    screen = SCREEN.replace(max_voltage_v=1e5, body_capacitance_f=20e-12)
    model = ContactModel(FINGER, screen, terms=ON | more, contact_spots=spots)
    end = float(model.solve(0.3, 0.0, 1e3).pull_in_voltage_v)
    below, above = model.solve(0.3, torch.tensor([0.999, 1.001]) * end, 1e3).status.tolist()
    assert (below != Status.PULL_IN, above) == (True, Status.PULL_IN)


def test_every_kind_of_drive_has_it() -> None:
    # A carrier in the virtual finger, and the mean of a period, against the mean of the sine.
    screen = SCREEN.replace(body_capacitance_f=60e-12)
    model = ContactModel(FINGER, screen, terms=ON)
    h0_m, frequency = screen.h0_m, 4000.0
    mean = float(model.solve(0.5, 200.0, frequency).mu)
    without = float(ContactModel(FINGER, screen).solve(0.5, 200.0, frequency).mu)
    assert without > 1.02 * mean
    felt = VirtualFinger(model, h0_m=h0_m).feel_carrier(
        np.full(200, 200.0), 1000, frequency, [0.05, 0.1], [0.0, 5.0], 0.0, 0.5
    )
    # The finger divides the voltage by real insulators, which differ from the skin's by their loss.
    assert felt.mu[-1] == pytest.approx(mean, rel=2e-3)
    # The contact follows the ripple: friction is convex in the pull, and a little above.
    period = float(model.over_period(0.5, 200.0, frequency, samples=32).mu.mean())
    assert mean < period < without
    # The same in units of another modulus and height, as a fit has them.
    strokes = StrokeConditions(*(np.array([v]) for v in (0.5, 200.0, frequency, 1e-3)))
    parameters = Parameters.of(FINGER, screen)
    predicted = StrokePredictor(model)(strokes, parameters.names, parameters.log_values)
    # At a crawl the response leaves the mean alone.
    assert float(np.exp(predicted.log_mu[0])) == pytest.approx(mean, rel=1e-4)
    rougher = FINGER.replace(
        roughness=FINGER.roughness.model_copy(update={"h_rms_m": 33e-6}), youngs_modulus_pa=60e6
    )
    scaled = parameters.started_at(h_rms_m=33e-6, youngs_modulus_pa=60e6)
    found = StrokePredictor(model)(strokes, scaled.names, scaled.log_values)
    direct = ContactModel(rougher, screen, terms=ON).solve(0.5, 200.0, frequency)
    assert float(np.exp(found.log_mu[0])) == pytest.approx(float(direct.mu), rel=1e-3)


def test_the_default_is_the_body_of_the_limit() -> None:
    assert Screen().body_capacitance_f == BODY_CAPACITANCE_F
    assert "body_capacitance_f" not in Screen().model_dump()
    for wrong in (0.0, -1e-12, float("nan")):
        with pytest.raises(InputError, match="body_capacitance_f"):
            Screen(body_capacitance_f=wrong)
    with pytest.raises(InputError, match="fingers_on_screen"):
        Finger(fingers_on_screen=0)


def test_a_capacitance_per_volt_of_a_flat_plate() -> None:
    # Thick film: gaps and spots are within 1e-3 of it, and so is the closed form.
    h0, body = 1e-2, 1e-14
    screen = SCREEN.replace(body_capacitance_f=body, max_voltage_v=1e4)
    state = ContactModel(FINGER, screen, terms=ON).solve(1.0, 1e4, None, h0)
    plate = VACUUM_PERMITTIVITY * FINGER.apparent_area_at_1n_m2 / h0
    left = fraction_left(plate, 1, body)
    assert left < 0.3
    # The mean gap adds 0.6 % to the film.
    assert float(state.peak_field_v_per_m) == pytest.approx(1e4 * left / h0, rel=1e-2)
