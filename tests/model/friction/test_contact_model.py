"""Friction under voltage against the paper, brute force, differences and limits."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from haptix import ContactModel, ContactState, Finger, Screen, Status
from haptix.model.contact import MeanField

EPS0 = 8.8541878128e-12
FIELDS = (
    "mu",
    "area_fraction",
    "pressure_pa",
    "gap_attraction_pa",
    "spot_attraction_pa",
    "mean_gap_m",
    "pull_in_voltage_v",
    "status",
)
H0 = 2e-7
# Between the nodes of its table ln I is a cubic in ln p, right to a few 1e-6.
TABLE = 5e-6

forces = st.floats(0.1, 1.0)
voltages = st.floats(0.0, 300.0)
thicknesses = st.floats(-6.8, -5).map(lambda e: 10.0**e)


def tensor(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def applied_pressure(finger: Finger, force: float) -> float:
    area = finger.apparent_area_at_1n_m2 * force**finger.apparent_area_exponent
    return force / area


def evenly_attracted(model: ContactModel, terms: dict[str, bool] | None = None) -> ContactModel:
    """Return the model whose attraction is a pressure, so that ``p = p0 + p_a`` holds."""
    return ContactModel(model.finger, model.screen, theory="corrected", terms=terms)


@pytest.mark.parametrize("force", [0.05, 0.1, 0.5, 1.0])
def test_without_voltage_there_is_the_area_of_the_load_alone(
    published: ContactModel, force: float
) -> None:
    finger = published.finger
    contact = MeanField(finger.roughness.spectrum(), finger.solid())
    pressure = applied_pressure(finger, force)
    area = float(contact.area_fraction(pressure))
    state = published.solve(force, 0.0)
    # Rounding: no table stands between.
    assert float(state.pressure_pa) == pytest.approx(pressure, rel=1e-14)
    expected = finger.frictional_shear_stress_pa * area / pressure
    assert float(state.mu) == pytest.approx(expected, rel=1e-12)
    assert float(state.area_fraction) == pytest.approx(area, rel=1e-12)
    assert float(state.attraction_pa) == 0.0
    assert int(state.status) == Status.OK
    # The mean gap comes from a cubic table.
    assert float(state.mean_gap_m) == pytest.approx(float(contact.mean_gap(pressure)), rel=1e-5)


def test_the_papers_fig_3c_without_voltage(published: ContactModel) -> None:
    mu = published.solve(tensor(0.1, 0.3, 1.0), 0.0).mu
    assert mu.tolist() == pytest.approx([0.26] * 3, abs=0.005)  # two digits are given


def test_the_papers_fig_3c_at_200_volts(published: ContactModel) -> None:
    force = tensor(0.1, 0.5, 1.0)
    ratio = published.solve(force, 200.0, h0_m=H0).mu / published.solve(force, 0.0, h0_m=H0).mu
    assert ratio.tolist() == pytest.approx([1.4] * 3, abs=0.05)  # "about 1.4"
    assert bool((ratio.diff() < 0).all())  # mu rises as F_N falls


@settings(max_examples=15, deadline=None)
@given(force=forces, voltage=voltages, more=st.floats(0.01, 100.0), h0=thicknesses)
def test_more_voltage_more_friction(
    semi_wet: ContactModel, force: float, voltage: float, more: float, h0: float
) -> None:
    state = semi_wet.solve(force, tensor(voltage, voltage + more), h0_m=h0)
    if bool((state.status == int(Status.OK)).all()):
        for rising in (state.mu, state.area_fraction, state.pressure_pa, state.attraction_pa):
            assert rising[1] > rising[0]
        assert state.mean_gap_m[1] < state.mean_gap_m[0]
    assert state.mu[1] >= state.mu[0]


@settings(max_examples=40, deadline=None)
@given(force=forces, voltage=st.floats(1.0, 300.0), h0=thicknesses, more=st.floats(1.01, 5.0))
def test_a_thicker_insulator_less_friction(
    semi_wet: ContactModel, force: float, voltage: float, h0: float, more: float
) -> None:
    state = semi_wet.solve(force, voltage, h0_m=tensor(h0, more * h0))
    assert state.pull_in_voltage_v[1] > state.pull_in_voltage_v[0]
    if int(state.status[1]) == Status.PULL_IN:  # which a thinner insulator has, too
        assert int(state.status[0]) == Status.PULL_IN
    if int(state.status[0]) == Status.OK:
        assert state.mu[1] < state.mu[0]


def test_behind_a_millimetre_of_insulator_nothing_pulls(semi_wet: ContactModel) -> None:
    # p_a = eps0 V0^2/4 h0^2 is 0.1 Pa at most, of a p0 of 3 kPa and more: 3e-5 of mu at 0.1 N,
    # and proportional to V0^2.
    force = tensor(0.1, 1.0)
    off = semi_wet.solve(force, 0.0, h0_m=1e-3).mu
    on = semi_wet.solve(force, 30.0, h0_m=1e-3).mu
    assert on.tolist() == pytest.approx(off.tolist(), rel=1e-6)


@pytest.mark.parametrize("spots", ["excluded", "included"])
@pytest.mark.parametrize("frequency", [None, 125.0])
def test_the_equilibrium_holds_by_the_solver_itself(spots: str, frequency: float | None) -> None:
    model = ContactModel(
        Finger.preset("semi-wet"),
        Screen.preset("3m-sct3250"),
        contact_spots=spots,
        theory="open-gaps",
    )
    force, voltage = tensor(0.1, 0.5, 1.0), tensor(20.0, 100.0, 200.0)
    state = model.solve(force, voltage, frequency, h0_m=H0)
    h0 = complex(H0)
    if frequency is not None:
        skin = model.finger.dielectric.relative_permittivity(tensor(frequency))
        h0 += 200e-6 / complex(skin)
    contact = MeanField(model.finger.roughness.spectrum(), model.finger.solid())
    thickness = torch.tensor(h0, dtype=torch.complex128)
    for i in range(3):
        pressure = float(state.pressure_pa[i])
        strength = EPS0 * float(voltage[i]) ** 2 / 4
        gaps = strength * float(contact.inverse_square_gap(pressure, thickness, "excluded"))
        inside = strength * float(contact.area_fraction(pressure)) / abs(h0) ** 2
        load = gaps + inside if spots == "included" else gaps
        applied = applied_pressure(model.finger, float(force[i]))
        assert pressure == pytest.approx(applied + load, rel=TABLE)
        assert float(state.gap_attraction_pa[i]) == pytest.approx(gaps, rel=2 * TABLE)
        assert float(state.spot_attraction_pa[i]) == pytest.approx(inside, rel=TABLE)
        assert float(state.attraction_pa[i]) == pytest.approx(gaps + inside, rel=2 * TABLE)


@pytest.mark.parametrize(
    ("force", "h0"),
    [
        (1.0, 2e-7),
        pytest.param(0.1, 5e-8, marks=pytest.mark.slow),
        pytest.param(0.5, 1e-6, marks=pytest.mark.slow),
    ],
)
def test_pull_in_by_brute_force(semi_wet: ContactModel, force: float, h0: float) -> None:
    semi_wet = evenly_attracted(semi_wet, terms={"finite-size": False})
    applied = applied_pressure(semi_wet.finger, force)
    low, high = 0.0, math.log10(31.0)
    for _ in "ab":  # the second time between the neighbours of the end
        pressure = applied * torch.logspace(low, high, 50, dtype=torch.float64)
        pull = semi_wet.contact.inverse_square_gap(pressure, tensor(h0), "excluded")
        voltage = (4 / EPS0 * (pressure - applied) / pull).sqrt()
        falling = (voltage.diff() < 0).nonzero()
        end = int(falling[0]) if len(falling) else len(voltage) - 1
        step = (high - low) / 49
        low, high = low + (end - 1) * step, min(low + (end + 1) * step, high)
    state = semi_wet.solve(force, 0.0, h0_m=h0)
    # A maximum between two points 0.6 % apart is flat to the square of that.
    found = float(state.pull_in_voltage_v)
    assert found == pytest.approx(float(voltage[end]), rel=1e-4)
    around = semi_wet.solve(force, tensor(0.999, 1 - 1e-9, 1 + 1e-9, 1.001, 5.0) * found, h0_m=h0)
    assert (around.status == Status.PULL_IN).tolist() == [False, False, True, True, True]
    for name in FIELDS:
        assert bool(getattr(around, name).isfinite().all()), name
    assert around.mu[0] < around.mu[1]
    # Past its end the light contact has the values of its end.
    assert around.mu[2:].tolist() == [float(around.mu[2])] * 3
    assert float(around.mu[1]) == pytest.approx(float(around.mu[2]), rel=1e-5)
    assert float(around.pressure_pa[2]) == pytest.approx(float(pressure[end]), rel=0.01)


def test_past_pull_in_every_value_is_that_of_the_end(semi_wet: ContactModel) -> None:
    semi_wet = evenly_attracted(semi_wet)
    end = float(semi_wet.solve(0.5, 0.0, h0_m=H0).pull_in_voltage_v)
    state = semi_wet.solve(0.5, tensor(1 + 1e-9, 2.0, 10.0) * end, h0_m=H0)
    applied = applied_pressure(semi_wet.finger, 0.5)
    for name in FIELDS:
        values = getattr(state, name)
        # The first point is 1e-9 past the end.
        assert values.tolist() == pytest.approx([float(values[0])] * 3, rel=1e-6), name
    # Also there p = p0 + p_a; the end of the branch is found in the same table.
    balance = applied + state.gap_attraction_pa
    assert balance.tolist() == pytest.approx(state.pressure_pa.tolist(), rel=1e-6)


def test_light_load_has_a_critical_voltage(semi_wet: ContactModel) -> None:
    semi_wet = evenly_attracted(semi_wet, terms={"finite-size": False})
    # mu_on/mu_off = 1/(1 - (V/Vc)^2), Vc = 2/sqrt(eps0 Lambda), where Lambda = I/p is constant.
    # It is not quite: Lambda falls by a tenth or so per doubling of p, and p rises by 12 % here.
    applied = applied_pressure(semi_wet.finger, 0.01)
    pull = float(semi_wet.contact.inverse_square_gap(applied, tensor(H0), "excluded"))
    critical = 2 / math.sqrt(EPS0 * pull / applied)
    voltage = tensor(0.05, 0.1, 0.2, 0.3) * critical
    off = semi_wet.solve(0.01, 0.0, h0_m=H0).mu
    on = semi_wet.solve(0.01, voltage, h0_m=H0).mu
    rise = on / off - 1
    expected = 1 / (1 - (voltage / critical) ** 2) - 1
    assert rise.tolist() == pytest.approx(expected.tolist(), rel=0.03)
    # Without the amplification of the load by itself, the first order alone, it would be 9 % less.
    assert float(rise[-1]) > 1.05 * float((voltage[-1] / critical) ** 2)


def test_gradients_match_differences(semi_wet: ContactModel) -> None:
    at = {"normal_force_n": 0.4, "voltage_v": 120.0, "h0_m": H0}
    for frequency in (None, 200.0):

        def mu(values: dict[str, Tensor | float], frequency: float | None = frequency) -> Tensor:
            return semi_wet.solve(frequency_hz=frequency, **values).mu

        leaves = {
            name: torch.tensor(v, dtype=torch.float64).requires_grad_() for name, v in at.items()
        }
        slopes = torch.autograd.grad(mu(leaves), list(leaves.values()))
        for name, slope in zip(at, slopes, strict=True):
            step = 1e-4 * at[name]
            up, down = ({**at, name: at[name] + side * step} for side in (1, -1))
            difference = float(mu(up) - mu(down)) / (2 * step)
            # Central differences: 1e-8 of curvature and 1e-12 of rounding over 1e-4.
            assert float(slope) == pytest.approx(difference, rel=1e-4), (name, frequency)


def test_gradients_past_pull_in_are_finite(semi_wet: ContactModel) -> None:
    voltage = tensor(0.0, 100.0, 5000.0).requires_grad_()
    (slope,) = torch.autograd.grad(semi_wet.solve(0.5, voltage, h0_m=H0).mu.sum(), voltage)
    assert bool(slope.isfinite().all())
    assert slope.tolist()[0] == 0.0 and slope.tolist()[1] > 0


def test_single_precision_results() -> None:
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    force, voltage = tensor(0.1, 0.5, 1.0)[:, None], tensor(0.0, 100.0, 200.0)
    single = ContactModel(finger, screen, dtype=torch.float32).solve(force, voltage)
    double = ContactModel(finger, screen).solve(force, voltage)
    for name in FIELDS[:-1]:
        value = getattr(single, name)
        assert value.dtype == torch.float32
        # The arithmetic is double: one rounding of 6e-8.
        torch.testing.assert_close(value.double(), getattr(double, name), rtol=6e-8, atol=0)
    assert double.mu.dtype == torch.float64
    assert bool((single.status == double.status).all())


def test_results_have_the_broadcast_shape(semi_wet: ContactModel) -> None:
    force = tensor(0.1, 0.4, 0.9)[:, None, None, None]
    voltage = tensor(0.0, 150.0)[:, None, None]
    frequency = tensor(50.0, 200.0, 800.0, 3200.0)[:, None]
    h0 = tensor(1e-7, 2e-7)
    state = semi_wet.solve(force, voltage, frequency, h0)
    flat = [t.reshape(-1) for t in torch.broadcast_tensors(force, voltage, frequency, h0)]
    again = semi_wet.solve(*flat)
    assert isinstance(state, ContactState)
    for name in FIELDS:
        value = getattr(state, name)
        assert tuple(value.shape) == (3, 2, 4, 2), name
        # The same numbers in another order of columns.
        torch.testing.assert_close(
            value.reshape(-1), getattr(again, name), rtol=1e-12, atol=0, equal_nan=False
        )
    one = semi_wet.solve(0.4, 150.0, 200.0, 2e-7)
    assert one.mu.shape == ()
    assert float(one.mu) == pytest.approx(float(state.mu[1, 1, 1, 1]), rel=1e-12)
    assert semi_wet.solve([0.1, 0.2], 10).mu.shape == (2,)


def test_more_states_than_are_solved_together(semi_wet: ContactModel) -> None:
    force = torch.linspace(0.1, 1.0, 9001, dtype=torch.float64)
    batch = semi_wet.solve(force, 100.0, h0_m=H0).mu
    some = [0, 4095, 4096, 8191, 8192, 9000]
    alone = [float(semi_wet.solve(float(force[i]), 100.0, h0_m=H0).mu) for i in some]
    assert batch[some].tolist() == pytest.approx(alone, rel=1e-12)  # rounding


def test_a_result_does_not_depend_on_what_was_asked_before() -> None:
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    fresh, used = ContactModel(finger, screen), ContactModel(finger, screen)
    used.solve(tensor(0.3, 0.31), 0.0)
    used.solve(tensor(0.02, 3.0), 0.0)
    # Of one force, low voltages stay at the end of the table that is made for them.
    a, b = (m.solve(tensor(0.37), torch.linspace(0.0, 180.0, 19), 125.0) for m in (fresh, used))
    for name in FIELDS:
        # The table's nodes lie on one lattice; only summation may differ.
        torch.testing.assert_close(getattr(a, name), getattr(b, name), rtol=1e-12, atol=0)


def test_without_an_h0_the_screens_own_is_taken() -> None:
    screen = Screen(insulator_thickness_m=1.6e-6, insulator_permittivity=8.0)
    model = ContactModel(Finger.preset("wet"), screen)
    assert float(model.solve(0.5, 150.0).mu) == float(model.solve(0.5, 150.0, h0_m=2e-7).mu)


def test_spots_included_is_the_stronger_reading(semi_wet: ContactModel) -> None:
    paper = ContactModel(semi_wet.finger, semi_wet.screen, contact_spots="included")
    assert float(paper.solve(0.5, 200.0, h0_m=H0).mu) > float(
        semi_wet.solve(0.5, 200.0, h0_m=H0).mu
    )


def test_low_frequencies_meet_the_insulator_alone(semi_wet: ContactModel) -> None:
    # At 1e-3 Hz d2/eps2 is 200 um w eps0 rho = 1e-12 m of 2e-7 m, a quarter-turn out of phase.
    slow = semi_wet.solve(0.5, 200.0, 1e-3, H0).mu
    still = semi_wet.solve(0.5, 200.0, None, H0).mu
    assert float(slow) == pytest.approx(float(still), rel=1e-6)
