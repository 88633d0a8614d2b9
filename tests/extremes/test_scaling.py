"""Only ratios of lengths, of moduli and of forces matter, for the whole model."""

import pytest
import torch

from haptix import ContactModel, ContactState, Finger, Screen, Status
from haptix.model.finger import Roughness

FORCE = torch.tensor([0.02, 0.2, 2.0], dtype=torch.float64)[:, None]
VOLTAGE = torch.tensor([0.0, 60.0, 150.0, 250.0], dtype=torch.float64)


def solve(length: float, modulus: float, fidelity: str) -> ContactState:
    """Lengths times one factor, moduli and stresses times another, at the same forces.

    A0 is divided by the factor of the moduli, which keeps p0/E; it is no length of the contact
    mechanics. Voltages go with ``h0 sqrt(E)``, for which eps0 V^2/h0^2 goes with E.
    """
    finger = Finger(
        youngs_modulus_pa=40e6 * modulus,
        layer_thickness_m=200e-6 * length,
        bulk_modulus_pa=1e5 * modulus,
        frictional_shear_stress_pa=8e6 * modulus,
        apparent_area_at_1n_m2=45e-6 / modulus,
        roughness=Roughness(
            h_rms_m=22e-6 * length,
            q0_per_m=1e3 / length,
            q_rolloff_per_m=4e3 / length,
            q1_per_m=1e9 / length,
        ),
    )
    model = ContactModel(finger, Screen(max_voltage_v=1e9), fidelity=fidelity)
    return model.solve(FORCE, VOLTAGE * length * modulus**0.5, None, 2e-7 * length)


@pytest.mark.parametrize("fidelity", ["mean-field", "closed-form"])
@pytest.mark.parametrize(
    ("length", "modulus"),
    [
        (137.0, 0.0171),
        pytest.param(3.7, 1.0, marks=pytest.mark.slow),
        pytest.param(1.0, 8.2e-3, marks=pytest.mark.slow),
        pytest.param(1e-3, 1.0, marks=pytest.mark.slow),
        pytest.param(211.0, 1.96, marks=pytest.mark.slow),
        pytest.param(1.0, 2.3, marks=pytest.mark.slow),
    ],
)
def test_common_factors(length: float, modulus: float, fidelity: str) -> None:
    tolerance = 1e-9  # rounding, multiplied near the end of the branch
    one, other = solve(1.0, 1.0, fidelity), solve(length, modulus, fidelity)
    # The pressure that skin bears in its spots is no ratio; where light contact ends is one.
    ended = [state.status == int(Status.PULL_IN) for state in (one, other)]
    assert ended[0].tolist() == ended[1].tolist()
    scales = {
        "mu": 1.0,
        "area_fraction": 1.0,
        "pressure_pa": modulus,
        "gap_attraction_pa": modulus,
        "spot_attraction_pa": modulus,
        "mean_gap_m": length,
        "pull_in_voltage_v": length * modulus**0.5,
    }
    for name, scale in scales.items():
        torch.testing.assert_close(
            getattr(other, name) / scale,
            getattr(one, name),
            rtol=tolerance,
            atol=0,
            msg=f"{name}: {{}}".format,
        )
