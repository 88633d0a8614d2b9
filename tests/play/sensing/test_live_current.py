"""The load of a mock's converter: panel and virtual fingers, as their touches say."""

import pytest

import haptix
from haptix.play.virtual_finger import Converter, LiveCurrent, PanelCircuit, VirtualCurrent

HERTZ = 4000.0
QUIET = Converter(noise=0.0, hum_a=0.0, pole_hz=1e12)  # turns 2 nF by 8e-18 F


@pytest.fixture(scope="module")
def model():
    return haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")


def test_a_live_finger_slides_rests_and_lifts(model):
    clock = [0.0]
    current = VirtualCurrent(model, HERTZ, QUIET)
    live = LiveCurrent(current, lambda: clock[0])

    def drawn():
        clock[0] += 0.002
        return live(100.0, clock[0]) - 2e-9

    assert abs(drawn()) < 1e-15
    live.touch(0.0, 0.0, 0.0, 0.4)
    resting = drawn()
    assert resting == pytest.approx(current.farads(0.4, 100.0, False))
    live.touch(0.01, 1.0, 0.0, 0.4)
    clock[0] = 0.01
    sliding = drawn()
    assert sliding == pytest.approx(current.farads(0.4, 100.0))
    assert abs(resting) < abs(sliding)
    live.touch(0.01, 50.0, 0.0, 0.4, touch_id=1)
    live.touch(0.02, 51.0, 0.0, 0.4, touch_id=1)
    assert drawn() == pytest.approx(2 * sliding)
    clock[0] = 0.2  # no report for long
    assert abs(drawn()) < abs(sliding)
    live.lift(0)
    live.lift(1)
    assert abs(drawn()) < 1e-15


def test_pole_and_drift_are_in_it(model):
    circuit = PanelCircuit(panel_per_s=1e-3)
    live = LiveCurrent(VirtualCurrent(model, HERTZ, Converter(), circuit), lambda: 0.0)
    assert live(100.0, 10.0) == pytest.approx(2e-9 * 1.01 / (1 + 0.02j))  # 4 kHz of 200 kHz


def test_only_a_mock_with_a_converter_can_be_loaded(model):
    device = haptix.open_device("mock:")
    with pytest.raises(haptix.InputError, match="sense_rate_hz"):
        LiveCurrent.on(device, VirtualCurrent(model, HERTZ))
