"""Everything a recording can have wrong is recognised by its name, and nothing else is."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from calibration import Stroke
from calibration.measure.recording_checks import check_recording
from calibration.measure.reduction import reduce_stroke

ONE_WAY = Stroke(
    number=1, normal_force_n=0.5, voltage_v=100, frequency_hz=125, there_and_back=False
)


def kinds(recording, fatal=True):
    return [one.kind for one in check_recording(recording, 0.3) if one.is_fatal or not fatal]


@settings(deadline=None, max_examples=25)
@given(
    # Below 0.08 a force is taken for one in lbf, and one way 2 % of cross-talk take 0.02 of mu.
    mu=st.floats(0.11, 3.0),
    ripple=st.floats(0.0, 0.9),
    force=st.sampled_from([0.1, 0.5, 0.9]),
    both=st.booleans(),
    fault=st.fixed_dictionaries(
        {
            "crosstalk": st.floats(-0.02, 0.02),
            "drift_n_per_s": st.floats(-3e-3, 3e-3),
            "tremor": st.floats(0, 0.05),
            "force_share": st.floats(0.9, 1.1),
            "speed_share": st.floats(0.9, 1.1),
            "rate_hz": st.sampled_from([2000.0, 10_000.0]),
        }
    ),
)
def test_what_a_person_does_in_a_good_laboratory_is_accepted(
    recorded, mu, ripple, force, both, fault
):
    stroke = ONE_WAY.model_copy(update={"normal_force_n": force, "there_and_back": both})
    assert kinds(recorded(stroke, mu, ripple, **fault), fatal=False) == []


def swapped(recording):
    return replace(
        recording,
        normal_force_n=recording.tangential_force_n,
        tangential_force_n=recording.normal_force_n,
    )


def times(**factors):
    return lambda recording: replace(
        recording, **{name: getattr(recording, name) * f for name, f in factors.items()}
    )


def clipped(recording):
    return replace(recording, tangential_force_n=np.minimum(recording.tangential_force_n, 0.15))


def cut(share):
    def apply(recording):
        stop = int(share * len(recording.t_s))
        names = ("t_s", "normal_force_n", "tangential_force_n", "x_mm", "drive_v")
        return replace(recording, **{name: getattr(recording, name)[:stop] for name in names})

    return apply


def without_some(recording):
    kept = np.ones(len(recording.t_s), dtype=bool)
    kept[8000:9000] = False
    names = ("t_s", "normal_force_n", "tangential_force_n", "x_mm", "drive_v")
    return replace(recording, **{name: getattr(recording, name)[kept] for name in names})


def not_a_number(recording):
    force = recording.normal_force_n.copy()
    force[100:120] = np.nan
    return replace(recording, normal_force_n=force)


def touched_early(recording):
    rng = np.random.default_rng(0)
    early = np.interp(recording.t_s, [0.0, 0.05, 0.2, 0.25], [0.0, 0.5, 0.5, 0.0])
    return replace(recording, normal_force_n=recording.normal_force_n + early * rng.uniform(0.9, 1))


def backwards(recording):
    t = recording.t_s.copy()
    t[500] = t[400]
    return replace(recording, t_s=t)


def held(recording, times=3):
    at = np.arange(len(recording.t_s)) // times * times
    names = ("normal_force_n", "tangential_force_n")
    return replace(recording, **{name: getattr(recording, name)[at] for name in names})


def every(step):
    def apply(recording):
        names = ("t_s", "normal_force_n", "tangential_force_n", "x_mm", "drive_v")
        return replace(recording, **{name: getattr(recording, name)[::step] for name in names})

    return apply


def constant(name, level):
    return lambda recording: replace(
        recording, **{name: np.full(len(recording.t_s), level), "findings": ()}
    )


FAULTS = {
    "swapped axes": swapped,
    "sign of the normal force": times(normal_force_n=-1),
    "sign of the tangential force": times(tangential_force_n=-1),
    "normal force in mN": times(normal_force_n=1000, tangential_force_n=1000),
    "tangential force in mN": times(tangential_force_n=1000),
    "normal force in gram-force": times(normal_force_n=101.97, tangential_force_n=101.97),
    "position in m": times(x_mm=1e-3),
    "position in um": times(x_mm=1e3),
    "position in inches": times(x_mm=1 / 25.4),
    "position in counts": times(x_mm=163.84),
    "position in other counts": times(x_mm=800),
    "tangential force in lbf": times(tangential_force_n=0.22481),
    "tangential force in kgf": times(tangential_force_n=0.10197),
    "both forces in ozf": times(normal_force_n=3.5969, tangential_force_n=3.5969),
    "normal force in lbf": times(normal_force_n=0.22481),
    "held samples": held,
    "100 samples a second": every(100),
    "dead normal force": constant("normal_force_n", 0.0),
    "dead tangential force": constant("tangential_force_n", 0.2),
    "tangential noise alone": times(tangential_force_n=1e-3),
    "times in ms": times(t_s=1e3),
    "times in min": times(t_s=1 / 60),
    "clipped": clipped,
    "stops half-way": cut(0.4),
    "samples dropped": without_some,
    "no numbers": not_a_number,
    "touched before the prompt": touched_early,
    "times that go back": backwards,
    "half the voltage": times(drive_v=0.5),
}
NAMES = {
    "swapped axes": "swapped axes",
    "sign of the normal force": "wrong sign",
    "sign of the tangential force": "wrong sign",
    "clipped": "clipped force",
    "held samples": "held samples",
    "100 samples a second": "slow sampling",
    "dead normal force": "dead channel",
    "dead tangential force": "dead channel",
    "tangential noise alone": "dead channel",
    "stops half-way": "stopped half-way",
    "samples dropped": "dropped samples",
    "no numbers": "no numbers",
    "touched before the prompt": "never zeroed",
    "times that go back": "wrong times",
    "times in min": "wrong times",
    "half the voltage": "drive off",
}


@pytest.mark.parametrize("both", [True, False], ids=["there and back", "one way"])
@pytest.mark.parametrize("force", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_has_its_name(recorded, fault, force, both):
    stroke = ONE_WAY.model_copy(update={"normal_force_n": force, "there_and_back": both})
    # Enough friction for 0.15 N to clip it at every force.
    mu = 2.5 if fault == "clipped" else 0.3
    found = kinds(FAULTS[fault](recorded(stroke, mu, crosstalk=0.01, tremor=0.02)))
    assert NAMES.get(fault, "wrong units") in found
    assert len(found) <= 2  # not everything at once


@pytest.mark.parametrize(("ripple", "share"), [(0.3, 0.95), (0.05, 0.9), (0.0, 0.9)])
def test_a_channel_that_is_full_before_its_noise_is_added(recorded, stroke, ripple, share):
    """No sample repeats another; mu is some 12 % too low."""
    clean = recorded(stroke, 0.3, ripple, noise_n=0.0, tremor=0.03)
    full = share * 0.3 * stroke.normal_force_n
    noise = np.random.default_rng(1).normal(0, 3e-3, len(clean.t_s))
    for limit, expected in ((full, ["clipped force"]), (np.inf, [])):
        shear = np.clip(clean.tangential_force_n, -limit, limit) + noise
        assert kinds(replace(clean, tangential_force_n=shear)) == expected


@pytest.mark.parametrize("sharp", [1, 4])
def test_stick_slip_is_no_saturation(recorded, stroke, sharp):
    made = recorded(stroke, 0.3, 0.0, tremor=0.02)
    phase = (40 * made.t_s) % 1.0
    saw = 1 + 0.3 * (phase ** (1 / sharp) - 0.5)  # loads, and the sharper the sooner, then slips
    assert kinds(replace(made, tangential_force_n=made.tangential_force_n * saw)) == []


@pytest.mark.parametrize("way", [0.0, 0.3])
def test_strokes_without_sliding(recorded, stroke, way):
    assert kinds(recorded(stroke, way_share=way)) == ["no sliding"]


def moved(recording, late_s):
    """The position that was there `late_s` before, as of a file that began later."""
    x_mm = np.interp(recording.t_s - late_s, recording.t_s, recording.x_mm)
    return replace(recording, x_mm=x_mm)


@pytest.mark.parametrize("late_ms", [50, 100, 200])
@pytest.mark.parametrize("speed", [25.0, 50.0, 100.0])
@pytest.mark.parametrize("both", [True, False])
def test_a_position_later_than_the_forces_is_refused_by_name(recorded, late_ms, speed, both):
    change = {"speed_mm_per_s": speed, "there_and_back": both}
    late = moved(recorded(ONE_WAY.model_copy(update=change)), late_ms / 1e3)
    (said,) = (one for one in check_recording(late, 0.3) if one.kind == "late position")
    assert said.is_fatal
    # The window of 20 ms moves an end by half of it at most; the finger is gone after 100 ms.
    found = float(re.search(r"for (\d+) ms or more", said.message)[1])
    assert min(late_ms, 100) - 10 <= found <= late_ms + 10


@pytest.mark.parametrize("stretch_mm", [0.3, 1.0, 3.0])
def test_skin_that_stretches_before_it_slips_is_no_late_position(recorded, stroke, stretch_mm):
    """Friction of a spring between finger and contact: it outlasts the slide, and turns later."""
    recording = recorded(stroke)
    mu, drag = 0.0, []
    for move in np.diff(recording.x_mm, prepend=recording.x_mm[0]) / stretch_mm:
        mu = min(max(mu + 0.3 * move, -0.3), 0.3)
        drag.append(mu)
    stretched = replace(recording, tangential_force_n=np.array(drag) * recording.normal_force_n)
    assert "late position" not in kinds(stretched)


@pytest.mark.parametrize(
    ("fault", "kind", "said"),
    [
        ({"force_share": 1.2}, "force off", r"got 0\.6 N \(\+20%\); press less"),
        ({"force_share": 0.8}, "force off", "press harder"),
        ({"speed_share": 1.3}, "speed off", "slide slower"),
        ({"speed_share": 0.7}, "speed off", "slide faster"),
    ],
)
def test_what_is_off_by_more_than_the_tolerance(recorded, stroke, fault, kind, said):
    (found,) = check_recording(recorded(stroke, **fault), 0.3)
    assert found.kind == kind
    assert found.is_fatal
    assert re.search(said, found.message)


def test_a_sensor_that_was_never_zeroed_is_made_up_for_and_named(recorded, stroke):
    (found, other) = check_recording(recorded(stroke, offset_n=3.0), 0.3)
    assert {found.kind, other.kind} == {"never zeroed"}
    assert not found.is_fatal


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1 / 25.4, "is it in inch?"),
        (163.84, "some 0.0061"),
        (800.0, "counts of an encoder"),
        (1000.0, "is it in um?"),
    ],
)
def test_the_unit_of_the_position_is_named(recorded, stroke, factor, said):
    (found,) = check_recording(times(x_mm=factor)(recorded(stroke)), 0.3)
    assert said in found.message


def test_a_ripple_that_looks_like_standing_still_is_refused(recorded):
    """At 2 kHz a ripple at 2 x 1 kHz is a constant: the mean friction would be off by its size."""
    one = ONE_WAY.model_copy(update={"frequency_hz": 1000.0})
    assert kinds(recorded(one, rate_hz=2000.0)) == ["slow sampling"]
    assert kinds(recorded(one, rate_hz=2300.0)) == []


def test_a_drive_that_was_not_measured_is_not_compared_with_the_plan(recorded, stroke):
    silent = replace(recorded(stroke), drive_v=np.zeros(len(recorded(stroke).t_s)))
    assert kinds(silent) == ["drive off"]
    assert kinds(replace(silent, assumed=("drive_v",))) == []


def test_the_unit_that_fits_is_named(recorded, stroke):
    for factor, unit in ((1000, "mN"), (101.97, "gf"), (0.10197, "kgf")):
        (found,) = check_recording(
            times(normal_force_n=factor, tangential_force_n=factor)(recorded(stroke, noise_n=2e-4)),
            idle_s=0.3,
        )
        assert f"is it in {unit}?" in found.message


def leaking(recording, name, time_constant_s):
    """What a charge amplifier shows: it forgets a force with its time constant."""
    kept = np.exp(-np.diff(recording.t_s)[0] / time_constant_s)
    values = lfilter([1.0, -1.0], [1.0, -kept], getattr(recording, name))
    return replace(recording, **{name: values})


@pytest.mark.parametrize("name", ["normal_force_n", "tangential_force_n"])
@pytest.mark.parametrize("both", [True, False], ids=["there and back", "one way"])
@pytest.mark.parametrize("time_constant_s", [0.5, 2.0, 3.0, 5.0])
def test_a_charge_amplifier_is_refused(recorded, name, both, time_constant_s):
    """2 s on one axis moved the friction by 4.6 %, and nothing was said."""
    stroke = ONE_WAY.model_copy(update={"there_and_back": both})
    made = leaking(recorded(stroke, tremor=0.01), name, time_constant_s)
    found = kinds(made)
    if time_constant_s == 5.0 and not found:
        # There and back most of what is lost cancels: a tenth of a JND is left.
        assert reduce_stroke(made).mu == pytest.approx(0.3, rel=0.011)
    else:
        # Of 0.5 s in both ways the force is off by as much as a wrong unit, and is none.
        assert "leaking charge" in found and "wrong units" not in found


def test_the_time_constant_of_a_charge_amplifier_is_said(recorded):
    made = leaking(recorded(ONE_WAY, noise_n=1e-3), "tangential_force_n", 2.0)
    (found,) = check_recording(made, 0.3)
    assert found.kind == "leaking charge" and re.search(
        r"constant of (1\.[89]|2|2\.[012]) s", str(found)
    )


def bent(recording, size_n):
    """A sensor that warms up: its zero nears an end with a time constant of a second."""
    add = size_n * (1 - np.exp(-(recording.t_s - recording.t_s[0])))
    return replace(recording, tangential_force_n=recording.tangential_force_n + add)


def test_a_zero_that_bends_is_refused_or_subtracted(recorded):
    """11 % of the friction where a line alone came off, which the idle ends show."""
    far = bent(recorded(ONE_WAY), 0.08)
    assert kinds(far) == ["bent zero"]
    near = bent(recorded(ONE_WAY), 0.02)
    assert kinds(near) == [] and kinds(near, fatal=False) == ["bent zero"]
    straight, found = (reduce_stroke(one).mu for one in (recorded(ONE_WAY), near))
    # A cubic leaves a fifth of what an exponential bends away from the line, some 0.003 N of 0.15.
    assert found == pytest.approx(straight, rel=0.006)


@pytest.mark.parametrize(("mu", "factor", "unit"), [(1.6, 3.5969, "ozf"), (0.3, 0.22481, "lbf")])
def test_a_tangential_channel_in_another_unit_than_the_normal_one(recorded, mu, factor, unit):
    (found,) = check_recording(times(tangential_force_n=factor)(recorded(ONE_WAY, mu)), 0.3)
    assert found.kind == "wrong units" and f"is it in {unit}?" in found.message
