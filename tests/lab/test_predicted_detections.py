"""Predicted detections: closed forms of observers, and a set from the command line."""

import json

import numpy as np
import pytest

from haptix.lab.analysis.power import People

SET = """name = "tones"
[stimuli.faint]
quantity = "volts"
drive_hz = 120.0
signal = { kind = "sine", amplitude = 6.0, frequency_hz = 120.0, length_s = 0.6 }
[stimuli.strong]
quantity = "volts"
drive_hz = 120.0
signal = { kind = "sine", amplitude = 60.0, frequency_hz = 120.0, length_s = 0.6 }
[stimuli.slow]
quantity = "volts"
drive_hz = 5.0
signal = { kind = "constant", value = 0.001, length_s = 0.6 }
[trials]
repeats = 10
"""


def test_people_who_are_alike_detect_by_the_weibull_function():
    people = People(between_db=0.0, slope=(3.5,), lapse=(0.02,))
    assert people.shares(0.0) == pytest.approx(np.full(4000, 0.98 * (1 - np.exp(-1))))
    assert people.shares(40.0) == pytest.approx(np.full(4000, 0.98))
    assert people.shares(-60.0).max() < 1e-6


def test_people_who_scatter_are_half_above_and_half_below_their_median():
    people = People(between_db=4.0, slope=(3.5,), lapse=(0.0,))
    at_threshold = people.shares(0.0)
    # 4000 people: the standard error of a share of one half is 0.8 %.
    assert np.mean(at_threshold > 1 - np.exp(-1)) == pytest.approx(0.5, abs=0.03)
    # Who is one deviation less sensitive needs 4 dB more.
    assert np.percentile(people.shares(4.0), 15.87) == pytest.approx(1 - np.exp(-1), abs=0.05)


def test_power_is_the_level_of_the_test_for_guessers_and_one_for_what_all_feel():
    people = People()
    # A t-test of few discrete shares: nearer to 0.05 than to 0.1.
    assert people.power(-80.0, 10, 20) == pytest.approx(0.05, abs=0.025)
    assert people.power(20.0, 8, 10) > 0.99
    few, many = (people.power(-4.0, count, 4) for count in (4, 24))
    assert few < many


def test_a_set_is_predicted_and_what_is_not_known_is_said(haptix_cli, own_folder):
    (own_folder / "tones.toml").write_text(SET)
    command = ("stimuli", "simulate", "tones.toml", "--predict")
    result = haptix_cli(*command, "--participants", "8,16", "--between-db", "2", "--json")
    rows = {row["stimulus"]: row for row in json.loads(result.out)}
    # Thresholds of 24.5 dB at 120 Hz, less what a tone of 0.6 s has not summed up: 0.11 dB.
    assert rows["strong"]["steady_db"] == pytest.approx(20 * np.log10(60) - 24.61, abs=0.25)
    assert rows["faint"]["steady_db"] == pytest.approx(20 * np.log10(6) - 24.61, abs=0.25)
    assert rows["faint"]["detected"] < 0.2 < 0.9 < rows["strong"]["detected"]
    for name in ("faint", "strong"):
        assert rows[name]["low"] <= rows[name]["detected"] <= rows[name]["high"]
    assert rows["strong"]["power_8"] > 0.99 and rows["faint"]["power_16"] < 0.5
    assert rows["slow"]["detected"] is None and rows["slow"]["power_8"] is None


@pytest.mark.parametrize(
    ("options", "said"),
    [(("--predict", "--threshold-db", "24"), "those of the set"), ((), "--threshold-db")],
)
def test_an_experiment_needs_thresholds_and_a_set_has_its_own(
    haptix_cli, own_folder, options, said
):
    (own_folder / "tones.toml").write_text(SET)
    result = haptix_cli("stimuli", "simulate", "tones.toml", *options)
    assert result.code == 2 and said in result.err
