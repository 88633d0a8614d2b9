"""Protocols: the paper's, and short ones that tell as much."""

import numpy as np
import pytest

import haptix
from calibration import Protocol, full_protocol, paper_protocol, short_protocol
from calibration.measure.measuring import drive_for
from calibration.plan.predict import StrokeConditions
from calibration.plan.protocol import expected_spread


def used(protocol):
    return StrokeConditions.of(one for one in protocol.strokes if not one.held_out)


def test_the_paper_s_strokes():
    strokes = [one for one in paper_protocol().strokes if not one.held_out]
    assert {(s.normal_force_n, s.voltage_v) for s in strokes} == {
        (force, volts) for force in (0.1, 0.3, 0.5, 0.7, 0.9) for volts in (0, 50, 100, 150, 200)
    }
    assert len(strokes) == 25
    one = strokes[0]
    assert (one.length_mm, one.speed_mm_per_s, one.frequency_hz) == (40.0, 50.0, 125.0)
    assert not one.there_and_back


@pytest.mark.parametrize("suffix", ["toml", "json"])
def test_round_trip(tmp_path, suffix):
    protocol = full_protocol(150.0)
    protocol.save(tmp_path / f"plan.{suffix}")
    assert Protocol.load(tmp_path / f"plan.{suffix}") == protocol


def test_a_person_writes_units(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(
        "[[strokes]]\nnumber = 1\nnormal_force_n = '300 mN'\nvoltage_v = '0.1 kV'\n"
        "frequency_hz = '0.2 kHz'\n"
    )
    (one,) = Protocol.load(path).strokes
    assert (one.normal_force_n, one.voltage_v, one.frequency_hz) == (0.3, 100.0, 200.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("strokes = []", "at least one stroke"),
        ("strokes = 3", "strokes"),
        ("colour = 'red'\n[[strokes]]\nnumber = 1", "strokes.0.normal_force_n|colour"),
        ("[[strokes]]\nnumber=1\nnormal_force_n=-1\nvoltage_v=0\nfrequency_hz=1", "greater than 0"),
        (
            "[[strokes]]\nnumber=1\nnormal_force_n=1\nvoltage_v=0\nfrequency_hz=1\n" * 2,
            "number of its own",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, said):
    path = tmp_path / "plan.toml"
    path.write_text(text)
    with pytest.raises(haptix.InputError, match=rf"plan\.toml: .*({said})"):
        Protocol.load(path)


def test_files_that_are_none(tmp_path):
    (tmp_path / "x.toml").write_text("= 3")
    for name in ("x.toml", "nowhere.toml"):
        with pytest.raises(haptix.HaptixError, match=name):
            Protocol.load(tmp_path / name)


def test_three_minutes_tell_half_as_well_as_all(predictor, parameters):
    short = short_protocol(predictor, parameters, minutes=3.0)
    assert short.duration_s <= 180.0
    spread = expected_spread(predictor, parameters, used(short))
    full = expected_spread(predictor, parameters, used(full_protocol()))
    assert spread["h0_m"] <= 2 * full["h0_m"]
    # Chosen strokes tell more than as many of the paper's.
    some = used(paper_protocol())
    kept = np.random.default_rng(0).permutation(25)[: len(used(short))]
    paper = expected_spread(
        predictor, parameters, StrokeConditions(*(c[kept] for c in vars(some).values()))
    )
    assert spread["h0_m"] < 0.5 * paper["h0_m"]


def test_a_screen_that_bears_less(predictor, parameters):
    for protocol in (
        paper_protocol(120.0),
        full_protocol(120.0),
        short_protocol(predictor, parameters, max_voltage_v=120.0),
    ):
        assert max(one.voltage_v for one in protocol.strokes) == 120.0


def test_no_time_at_all(predictor, parameters):
    with pytest.raises(haptix.InputError, match=r"minutes: .*10 strokes"):
        short_protocol(predictor, parameters, minutes=0.1)


def test_every_stroke_can_be_played(predictor, parameters):
    """The current through a body limits the carrier below 200 V, and a driver plays all."""
    for plan in (full_protocol(), short_protocol(predictor, parameters)):
        carrier = max(s.voltage_v for s in plan.strokes if s.frequency_hz == 4000.0)
        # 0.7 mA through 150 pF: 185.7 V.
        assert 175.0 < carrier < 0.7e-3 / (2 * np.pi * 4000.0 * 150e-12)
        limits = haptix.open_device("mock:").limits
        for stroke in plan.strokes:
            limits.check(drive_for(stroke, plan, 48_000.0).volts, 0.0, 48_000.0)
