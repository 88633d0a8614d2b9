"""A live renderer that learns who touches: by steps, with a virtual finger's current."""

import numpy as np
import pytest

import haptix
from firmware_io.protocol import codes_to_volts
from haptix.feel.materials import FrictionField
from haptix.feel.motion import Trajectory
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.play.render import DirectWave, LiveRenderer, LiveSettings
from haptix.play.render.adapting import Adaptation
from haptix.play.sensing import ContactCurrent, FingerObserver, Knowledge
from haptix.play.virtual_finger import LiveCurrent, VirtualCurrent
from tests.live_strokes import CARRIER_HZ, HALF, RATE, SteppedRenderer, stroke

BEGIN_S, END_S = 0.6, 1.4


class Contrast(FrictionField):
    """The same friction everywhere: 8 % above that without voltage."""

    target = "contrast"
    outside = 0.08

    def _sample(self, x_mm, y_mm, footprint_mm):
        return np.full(np.shape(x_mm), 0.08)


@pytest.fixture(scope="module")
def contact(model):
    return ContactCurrent.of_model(model, CARRIER_HZ)


@pytest.fixture(scope="module")
def stiffer(model):
    """As the dry preset beside the semi-wet one: far beyond what the current may err by."""
    finger = model.finger
    moduli = {name: 25 * getattr(finger, name) for name in ("youngs_modulus_pa", "bulk_modulus_pa")}
    return haptix.ContactModel(finger.replace(**moduli), model.screen)


def play(surface, observer, person, lie=lambda reading: reading, until_s=END_S):
    """A stroke whose current is read as it is played; return the renderer, and the readings."""
    renderer = SteppedRenderer(surface, Contrast())
    if observer is not None:
        renderer.adapted = Adaptation(observer)
    current = VirtualCurrent(person, CARRIER_HZ, seed=1)
    path = Trajectory.of([BEGIN_S, END_S], [5.0, 85.0], 10.0, 0.5)
    mock, heard, estimates = renderer.device.mock, 0, []
    size = round(RATE / current.converter.rate_hz)
    with renderer:
        events = stroke(end_s=until_s, begin_s=BEGIN_S)
        zero_s = renderer.now_s() - len(mock.output[0]) / RATE
        for k in range(int(until_s / 0.005)):
            at_s = k * 0.005
            while events and events[0].t_s <= at_s:
                event = events.pop(0)
                renderer.event(event._replace(t_s=event.t_s), event.t_s)
            renderer.run_until(at_s)
            codes = mock.output[0]
            whole = (len(codes) - heard) // size * size
            if observer is None or not whole:
                continue
            volts = codes_to_volts(codes[heard : heard + whole], mock.about.full_scale_mv / 1e3)
            for reading in current.read(volts, RATE, path, zero_s + heard / RATE):
                renderer.sensed(lie(reading))
            heard += whole
            estimates.append((renderer.now_s(), renderer.stats.finger))
    return renderer, estimates


def test_who_is_attracted_less_gets_more(surface, contact, stiffer):
    plain, _ = play(surface, None, stiffer)
    renderer, estimates = play(surface, FingerObserver(contact), stiffer)
    found = estimates[-1][1]
    assert found.state is Knowledge.LEARNS
    assert found.log_gain < -0.2
    # b V^2 is asked for: the amplitude goes with the root of the attraction. The estimate of the
    # last 20 ms is not played yet.
    rise = np.log(renderer.played.amplitude_v[-50] / plain.played.amplitude_v[-50])
    assert rise == pytest.approx(-found.log_gain / 2, abs=0.05)
    assert "finger: learns" in str(renderer.stats)


def largest_step_jnd(renderer):
    """The largest change of the friction that the surface's finger feels in 10 ms."""
    amplitude = renderer.played.amplitude_v
    step_s = renderer.step_s
    times = renderer.played.t0_s + step_s * np.arange(len(amplitude))
    steady = (times > BEGIN_S + 0.1) & (times < END_S - 0.05)  # between the fades
    mu = np.array([float(m) for m in renderer.slice.mu(np.full(len(amplitude), 0.5), amplitude)])
    mu = mu[steady]
    window = round(0.010 / step_s)
    return float((np.abs(mu[window:] / mu[:-window] - 1) / WEBER_FRACTION).max())


def test_what_is_felt_never_steps(surface, contact, stiffer):
    lying = []

    def dies(reading):
        lying.append(reading.t_s)
        return reading._replace(in_phase_a=0.0, quadrature_a=0.0) if reading.t_s > 1.2 else reading

    renderer, estimates = play(surface, FingerObserver(contact), stiffer, dies)
    states = {estimate.state for at_s, estimate in estimates if at_s > 1.2 + 0.017}
    assert states == {Knowledge.SENSOR}
    largest = largest_step_jnd(renderer)
    assert 0 < largest < 0.25  # and it did change


def liar(seed):
    """A sensor that tells the truth for a while, and then anything, with any time."""
    rng = np.random.default_rng(seed)
    told = []

    def lie(reading):
        told.append(reading)
        t_s, in_phase, ahead, *_ = reading
        if t_s < BEGIN_S + 0.2 or rng.random() < 0.5:
            return reading
        lies = [
            reading._replace(quadrature_a=rng.choice([np.nan, np.inf, 1e9])),
            reading._replace(in_phase_a=-in_phase, quadrature_a=-ahead),
            reading._replace(quadrature_a=ahead * rng.uniform(0, 3)),
            reading._replace(driven_v=float(rng.choice([0.0, -100.0, 1e9, np.nan]))),
            reading._replace(t_s=t_s + rng.choice([-0.05, 1e5, -1e5, np.nan])),
            reading._replace(is_saturated=True),
            told[int(rng.integers(len(told)))],
        ]
        return lies[int(rng.integers(len(lies)))]

    return lie


@pytest.mark.parametrize(
    "seeds", [range(1), pytest.param(range(1, 30), marks=pytest.mark.slow)], ids=["one", "many"]
)
def test_no_lie_of_a_sensor_breaks_a_limit_or_steps(surface, contact, stiffer, seeds):
    """`benchmarks/sensing.py hostile 200000` has shorter streams, and more of them."""
    for seed in seeds:
        renderer, estimates = play(surface, FingerObserver(contact), stiffer, liar(seed))
        assert all(np.isfinite(estimate.log_gain) for _, estimate in estimates)
        assert np.abs(renderer.device.mock.played_v).max() <= renderer.highest_v * (1 + 1e-4)
        assert largest_step_jnd(renderer) < 0.25


def test_off_it_plays_the_same_bits(surface, model):
    played = [play(surface, None, model)[0].device.mock.played_codes for _ in range(2)]
    np.testing.assert_array_equal(*played)


def test_no_amplitude_is_beyond_the_limit(surface, contact, stiffer):
    renderer, _ = play(surface, FingerObserver(contact), stiffer, until_s=0.9)
    assert np.abs(renderer.device.mock.played_v).max() <= renderer.highest_v * (1 + 1e-4)


def test_the_panel_is_probed_while_nobody_touches(surface, contact, stiffer):
    observer = FingerObserver(contact)
    play(surface, observer, stiffer, until_s=0.5)
    # 500 ms at 20 V: 0.1 % a reading and 12 bits leave some 0.1 % of 2 nF, less a pole's 1.5 %.
    assert abs(observer.baseline_f) == pytest.approx(2e-9, rel=3e-3)


def test_what_cannot_sense_says_so(surface, contact):
    device = haptix.open_device("mock:")
    with pytest.raises(haptix.InputError, match="expected a carrier"):
        LiveRenderer(surface, HALF, device, DirectWave(CARRIER_HZ), sense=FingerObserver(contact))
    with pytest.raises(haptix.InputError, match="sense"):
        LiveRenderer(surface, HALF, device, sense="yes")
    with pytest.raises(haptix.InputError, match="sense=True"):
        LiveRenderer(surface, HALF, device, settings=LiveSettings()).sensed(None)


def slide_on_a_driver(
    surface, observer, person, fails_at_s=np.inf, stalls_s=0.0, failure="silent", rate_hz=250
):
    """A stroke on a mock that measures; return its states in time, and the largest step felt."""
    address = f"mock:pace=stepped,mode=envelope,sense_rate_hz={rate_hz}"
    renderer = SteppedRenderer(surface, Contrast(), address=address)
    renderer.adapted = Adaptation(observer)
    converter = renderer.device.mock.converter
    live = LiveCurrent.on(renderer.device, VirtualCurrent(person, CARRIER_HZ))
    states = []
    with renderer:
        begin_s = renderer.now_s()
        for event in stroke(end_s=END_S, begin_s=BEGIN_S, force=0.5):
            at_s = begin_s + event.t_s
            live.touch(at_s, event.x_mm, event.y_mm, 0.5)
            renderer.event(event._replace(t_s=at_s), at_s)
            if event.t_s > 1.1 and round(100 * event.t_s) % 5 == 0:
                renderer.device.clock.sleep(stalls_s)  # the thread that plays does nothing
            for k in range(1, 5):
                if event.t_s + 0.002 * k >= fails_at_s:
                    converter.failure = failure
                renderer.run_until(at_s + 0.002 * k)
                finger = renderer.stats.finger
                states.append((renderer.now_s() - begin_s, finger.state, finger.log_gain))
    return states, largest_step_jnd(renderer)


def test_a_driver_that_measures_is_read_by_the_renderer_itself(surface, contact, stiffer):
    states, largest = slide_on_a_driver(surface, FingerObserver(contact), stiffer)
    assert 0 < largest < 0.25
    assert states[-1][1] is Knowledge.LEARNS
    assert states[-1][2] < -0.2


@pytest.mark.parametrize(
    ("failure", "rate_hz"),
    [
        ("silent", 250),
        pytest.param("silent", 4000, marks=pytest.mark.slow),
        pytest.param("dead", 250, marks=pytest.mark.slow),
        ("stuck", 250),
        pytest.param("inverted", 250, marks=pytest.mark.slow),
        ("late", 250),
    ],
)
def test_a_driver_whose_sensor_fails_leads_back_to_open_loop_in_10_ms(
    surface, contact, stiffer, failure, rate_hz
):
    """By the driver's clock, from its first sample on that is wrong, looked at each 2 ms."""
    states, largest = slide_on_a_driver(
        surface, FingerObserver(contact), stiffer, 1.2, failure=failure, rate_hz=rate_hz
    )
    assert {state for at_s, state, _ in states if 1.1 < at_s < 1.2 - 1e-6} == {Knowledge.LEARNS}
    late = [(state, gain) for at_s, state, gain in states if 1.2 + 0.010 - 1e-6 < at_s < 1.39]
    assert len(late) > 50
    assert {state for state, _ in late} == {Knowledge.SENSOR}
    assert {gain for _, gain in late} == {0.0}
    assert largest < 0.25


def test_a_stall_of_the_host_is_not_held_against_the_sensor(surface, contact, stiffer):
    """A touch that waited is rendered before the readings that waited are taken."""
    states, _ = slide_on_a_driver(surface, FingerObserver(contact), stiffer, stalls_s=0.02)
    assert Knowledge.SENSOR not in {state for at_s, state, _ in states if at_s > 1.1}
    assert states[-1][1] is Knowledge.LEARNS


def test_a_driver_without_a_sensor_says_so(surface, contact, caplog):
    renderer = SteppedRenderer(surface, Contrast())
    renderer.adapted = Adaptation(FingerObserver(contact))
    with renderer:
        assert renderer.stats.finger.state is Knowledge.NO_SENSOR
    assert "reports no current" in caplog.text
