"""The simulator that calibrations are judged by: of its own, and right where both agree."""

import ast
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import haptix
from calibration import Parameters, StrokePredictor
from calibration.plan.predict import StrokeConditions
from haptix.model.perception.thresholds import WEBER_FRACTION

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.mark.parametrize("name", ["independent_finger", "rigs", "oracle"])
def test_truths_import_nothing_of_the_package(name):
    found = set()
    for node in ast.walk(ast.parse((BENCHMARKS / f"{name}.py").read_text())):
        if isinstance(node, ast.Import):
            found |= {one.name.partition(".")[0] for one in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add((node.module or "").partition(".")[0])
    own = {"independent_finger", "oracle", "numpy", "scipy", "mpmath"}
    assert found <= own | sys.stdlib_module_names


@pytest.fixture(scope="module")
def simulator():
    sys.path.insert(0, str(BENCHMARKS))
    try:
        return import_module("independent_finger")
    finally:
        sys.path.remove(str(BENCHMARKS))


@pytest.fixture(scope="module")
def simulated(simulator):
    """The oracle's contact at few pressures; friction is smooth in between."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulator, "PRESSURES", np.geomspace(1.5e3, 2e5, 14))
        patch.setattr(simulator, "AREAS", np.geomspace(2e-5, 8e-5, 3))
        low, high = np.log(simulator.PRESSURES[[0, -1]])
        patch.setattr(simulator, "_FINE", np.linspace(low, high, 1000))
        yield simulator.Contact.mean_field(simulator.CORRECTED)


@pytest.mark.slow
def test_friction_is_that_of_the_model_by_other_means(simulator, simulated, finger, screen):
    own = Parameters.of(finger, screen)
    values = {one.name: one.value for one in own.started_at(skin_dielectric_scale=1.4).all}
    true = simulator.Finger(simulated, values)
    places = np.array([(f, v, h) for f in (0.3, 0.8) for v in (0.0, 150.0) for h in (60.0, 4e3)])
    known = own.started_at(skin_dielectric_scale=1.4)
    conditions = StrokeConditions(*np.vstack([places.T, np.full(len(places), 50.0)]))
    # The simulator spreads the attraction evenly, as this theory does.
    model = StrokePredictor(haptix.ContactModel(finger, screen, theory="corrected"))
    found = model(conditions, known.names, known.log_values, jacobian=False)
    mu = np.array([true.mean_mu(*one) for one in places])
    # A twentieth of a JND: gaps sorted into bins, and the package's own tables.
    assert np.abs(mu / np.exp(found.log_mu) - 1).max() < 0.05 * WEBER_FRACTION


def test_boundary_elements_press_until_nothing_overlaps(simulator):
    """A sphere of one cell: Hertz's area, and no gap where it touches."""
    points, radius, side = 128, 0.05, 2 * np.pi / simulator.Q0
    place = (np.arange(points) / points - 0.5) * side
    x, y = np.meshgrid(place, place)
    height = -(x**2 + y**2) / (2 * radius)
    wave = simulator.Q0 * np.hypot(*np.meshgrid(*[np.fft.fftfreq(points, 1 / points)] * 2))
    wave[0, 0] = simulator.Q0
    modulus = 1e6
    compliance = 2 / (modulus * wave)
    compliance[0, 0] = 0.0
    load = 0.02
    wanted = load / side**2
    pressure, gap = simulator._pressed(height, compliance, wanted, np.full_like(height, wanted))
    assert pressure.mean() == pytest.approx(wanted, rel=1e-9)
    contact = (3 * load * radius / (4 * modulus)) ** (1 / 3)
    # A rim of half a point's width either side.
    width = side / points / contact
    assert np.sqrt((pressure > 0).mean() * side**2 / np.pi) / contact == pytest.approx(1, abs=width)
    assert gap[pressure > 0].max() < 1e-3 * simulator.H_RMS
