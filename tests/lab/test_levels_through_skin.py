"""Sensation levels by what the skin attracts: steady parts, edges, and drives of other shapes."""

import numpy as np
import pytest

import haptix
from haptix.feel.along_path import grating
from haptix.feel.signals.shapes import Sine, Square
from haptix.lab.stimuli import Stimulus
from haptix.lab.stimuli.rendering import Apparatus, Rendering, Skin, Tally
from haptix.model.perception.sensation import SensationInTime
from haptix.model.perception.thresholds import Perception

RATE = 48_000.0


@pytest.fixture(scope="module")
def level_of():
    """Level of a stimulus as a set's sidecar has it, by a coarse surface."""
    finger, screen = haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    ranges = {"normal_force_n": 0.5, "frequency_hz": (15.0, 4000.0), "voltage_v": (0.0, 100.0)}
    apparatus = Apparatus.over(finger, screen, ranges)

    def level(stimulus):
        skin = apparatus.skin(stimulus)
        rendering = Rendering(stimulus, apparatus.responses(stimulus)[0], RATE, skin)
        tally = Tally(SensationInTime(Perception.default(), RATE, skin))
        for block in rendering.stream():
            tally.take(block, rendering.response)
        return tally.sensation.finish()

    return level


def drive(shape, frequency_hz, volts=60.0, length_s=1.5):
    signal = shape(amplitude=volts, frequency_hz=frequency_hz).lasting(length_s)
    return Stimulus("a", signal, "volts", carrier_hz=None, drive_hz=frequency_hz)


def contrast(signal, length_s=1.5):
    return Stimulus("a", signal.lasting(length_s))


def test_gratings_of_three_periods_have_three_levels(level_of):
    # At 80 mm/s they are felt at 80, 40 and 20 Hz, where no threshold is known: what is left are
    # harmonics of the pull, weaker the slower they are. The click at the ends stands by itself.
    slow = [level_of(contrast(grating(0.04, p, 80.0, offset=0.05))) for p in (1.0, 2.0, 4.0)]
    levels = [-60.0 if one.sensation_db is None else one.sensation_db for one in slow]
    assert levels[0] > levels[1] + 3 > levels[2] + 6
    clicks = [one.edges_db for one in slow]
    assert clicks == pytest.approx([clicks[0]] * 3, abs=0.2)  # all end at the same friction
    assert all(one.outside_share > 0.9 for one in slow)
    # At 400 mm/s at 400, 200 and 160 Hz, where the data rise from 18.7 to 25.8 dB.
    fast = [level_of(contrast(grating(0.01, p, 400.0, offset=0.05))) for p in (1.0, 2.0, 2.5)]
    at = [one.sensation_db for one in fast]
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    known = Perception.default().channels[0]
    # Depth is the same: they differ by the thresholds, and by the skin that their sines meet.
    for felt, level in ((200.0, at[1]), (160.0, at[2])):
        pulls = [float(model.solve(0.5, 1.0, hz / 2).attraction_pa) for hz in (400.0, felt)]
        lost = known.threshold(felt) - known.threshold(400.0) + 10 * np.log10(pulls[1] / pulls[0])
        assert at[0] - level == pytest.approx(lost, abs=0.3)
    for one in fast:  # and the click at the ends stands by itself
        assert one.edges_db is not None


def test_friction_sines_of_three_depths_differ_by_their_depths(level_of):
    half, one, more = (
        level_of(contrast(Sine(depth, 250.0) + 0.05)).sensation_db for depth in (0.005, 0.01, 0.015)
    )
    # The pull goes with the depth, the drive with its root.
    assert one - half == pytest.approx(10 * np.log10(2), abs=0.1)
    assert more - one == pytest.approx(10 * np.log10(1.5), abs=0.1)


@pytest.mark.parametrize("frequency_hz", [80.0, 120.0, 180.0, 270.0, 390.0])
def test_a_square_at_higher_frequencies_is_felt_much_like_a_sine_of_equal_peak(
    level_of, frequency_hz
):
    """Alike above 60 Hz (Vardar, Guclu, Basdogan 2017, abstract).

    The page says by how much it is not. Without dispersion a square attracts steadily, and nothing
    of it is felt but its clicks.
    """
    sine, square = (level_of(drive(shape, frequency_hz)).sensation_db for shape in (Sine, Square))
    assert abs(square - sine) < 3.5


@pytest.mark.parametrize("frequency_hz", [20.0, 30.0, 45.0])
def test_a_square_is_felt_better_below_60_hz(level_of, frequency_hz):
    """A sine there has no threshold in the data. It is U-shaped: none is below that at 80 Hz."""
    square = level_of(drive(Square, frequency_hz))
    at_most = 20 * np.log10(60) - Perception.default().channels[0].threshold(160.0)
    assert square.sensation_db > at_most


def test_a_sine_drive_is_at_its_own_threshold(level_of):
    """Skin and finger are those of the threshold: whatever they do, they do to both."""
    found = level_of(drive(Sine, 120.0))
    assert found.sensation_db == pytest.approx(20 * np.log10(60) - 24.5, abs=0.2)
    assert found.channel == "pacinian"


def test_a_carrier_is_attenuated_by_the_skin_that_it_meets(level_of):
    """A 4 kHz carrier meets skin that is thicker, electrically, than 100 Hz do."""
    modulated = Stimulus("a", (Sine(30.0, 200.0) + 60.0).lasting(1.5), "volts", carrier_hz=4000.0)
    t = np.arange(round(1.5 * RATE)) / RATE
    plain = SensationInTime(Perception.default(), RATE)
    plain.take((60 + 30 * np.sin(2 * np.pi * 200 * t)) ** 2 / 4)
    lost = plain.finish().sensation_db - level_of(modulated).sensation_db
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    pulls = [float(model.solve(0.5, 1.0, f).attraction_pa) for f in (100.0, 4000.0)]
    assert lost == pytest.approx(10 * np.log10(pulls[0] / pulls[1]), abs=0.3)
    assert lost > 0.5


def test_a_square_ripples_as_the_virtual_finger_feels_it():
    """One gap stands for all: the whole contact, solved, has the same ripple of friction."""
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    finger = haptix.play.virtual_finger.VirtualFinger(model, has_response=False)
    skin = Skin(model, 0.5, 120.0)
    t = np.arange(round(0.3 * RATE)) / RATE
    ripples = []
    for volts in (
        30 * np.sin(2 * np.pi * 120 * t),
        30 * np.sign(np.sin(2 * np.pi * 120 * t + 1e-9)),
    ):
        felt = finger.feel(volts, RATE, [0.1, 0.2], [0.0, 8.0], 5.0, 0.5)
        pull = skin.voltage(volts, RATE)[round(0.1 * RATE) : round(0.2 * RATE)] ** 2
        wave = (np.exp(-2j * np.pi * 240 * np.arange(n) / n * 0.1) for n in (1000, 4800))
        ripples.append([abs(np.mean(one[:n] * w)) for one, n, w in zip(
            (felt.mu, pull), (1000, 4800), wave, strict=True)])  # fmt: skip
    (sine_mu, sine_pull), (square_mu, square_pull) = ripples
    # 0.8 dB of the pull; the friction is not quite linear in it.
    assert square_pull / sine_pull == pytest.approx(square_mu / sine_mu, rel=0.2)
