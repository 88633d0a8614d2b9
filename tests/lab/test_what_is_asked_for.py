"""Noise by its exponent, morphs, variants, equal means, levels that are possible, files again."""

import json
import os
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

from firmware_io import DriveLimits
from haptix.base.errors import HaptixError, InputError
from haptix.feel import Morph, Sine, TimeNoise, grating
from haptix.feel.along_path import speed_from
from haptix.feel.signals.signal import signal_from
from haptix.lab.stimuli import Stimulus, StimulusSet, TrialPlan
from haptix.lab.stimuli.designs import equal_mean, highest_level, matched_intensity, variants_of
from haptix.lab.stimuli.recipe import Recipe
from haptix.lab.stimuli.set_plan import CODES, Trigger, events, pulses
from haptix.lab.stimuli.stimulus_set import make_again
from haptix.model.perception.thresholds import Perception

RATE = 48_000.0


@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0, -1.0])
def test_noise_falls_with_its_exponent(exponent):
    noise = TimeNoise(0.2, (8.0, 1000.0), seed=4, exponent=exponent)
    values = noise.values(0, 1 << 19, RATE)
    assert values.std() == pytest.approx(0.2, rel=0.1)  # brown noise has few slow waves in 11 s
    power = np.abs(np.fft.rfft(values * np.hanning(len(values)))) ** 2
    felt = np.fft.rfftfreq(len(values), 1 / RATE)
    edges = np.geomspace(16, 500, 11)
    mean = [power[(felt >= a) & (felt < b)].mean() for a, b in pairwise(edges)]
    slope = np.polyfit(np.log(np.sqrt(edges[1:] * edges[:-1])), np.log(mean), 1)[0]
    # Some 60 lines in the lowest of ten bands: 13 % each, and a lever of 3.4.
    assert slope == pytest.approx(-exponent, abs=0.15)
    assert power[felt > 1010].max() < 1e-6 * power.max()
    with pytest.raises(InputError, match="above it"):
        TimeNoise(0.2, (0.0, 10.0), 1, exponent=1.0)


def test_a_morph_does_not_dip():
    a = TimeNoise(0.10, (20.0, 200.0), seed=1, mean=0.2).lasting(1.0)
    b = TimeNoise(0.04, (100.0, 300.0), seed=2, mean=0.4).lasting(1.0)
    spread = [one.values(0, 48_000, RATE).std() for one in (a, b)]
    mean = [one.values(0, 48_000, RATE).mean() for one in (a, b)]
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        morph = Morph(a, b, share)
        values = morph.values(0, 48_000, RATE)
        # Exact by construction, over the whole signal.
        assert values.std() == pytest.approx((1 - share) * spread[0] + share * spread[1], rel=1e-9)
        assert values.mean() == pytest.approx((1 - share) * mean[0] + share * mean[1], rel=1e-9)
        np.testing.assert_array_equal(values[700:900], morph.values(700, 200, RATE))
    np.testing.assert_allclose(Morph(a, b, 0.0).values(0, 99, RATE), a.values(0, 99, RATE))
    assert signal_from(json.loads(json.dumps(morph.describe()))) == morph
    # Of one and the same, nothing changes; of a signal and its mirror image nothing is left.
    tone = Sine(1.0, 50.0).lasting(0.1)
    same = Morph(tone, tone, 0.5).values(0, 4800, RATE)
    np.testing.assert_allclose(same, tone.values(0, 4800, RATE), atol=1e-12)
    with pytest.raises(InputError, match="cancel"):
        Morph(tone, -1 * tone, 0.5).values(0, 10, RATE)
    with pytest.raises(InputError, match="one length"):
        Morph(tone, tone.lasting(0.2), 0.5)


def noise(seed, mean=0.08):
    return Stimulus(f"n{seed}", TimeNoise(0.01, (20.0, 200.0), seed, mean=mean).lasting(0.2))


def test_variants_are_a_factor():
    made = variants_of([noise(1), noise(2)], 3)
    assert [one.name for one in made] == [f"n{s}-v{v}" for s in (1, 2) for v in (1, 2, 3)]
    assert [one.conditions["variant"] for one in made] == [1, 2, 3, 1, 2, 3]
    seeds = [one.signal.seeds for one in made]
    assert len(set(seeds)) == 6 and seeds[0] == (1,)
    assert [one.signal.seeds for one in variants_of([noise(2)], 3)] == seeds[3:]
    with pytest.raises(InputError, match="random"):
        variants_of([Stimulus("s", Sine(0.1, 20.0).lasting(0.1))], 2)


def test_equal_means_are_solved_and_reported(finger, screen, tmp_path, own_cache):
    stimuli = [
        noise(3, 0.05),
        Stimulus("sine", (Sine(0.05, 20.0) + 0.07).lasting(0.2)),
        Stimulus("ribs", grating(0.03, 2.0, 80.0, offset=0.09).lasting(0.2)),
    ]
    made = equal_mean(stimuli, 0.1)
    assert made[1].conditions["shift"] == pytest.approx(0.03)
    tables = StimulusSet("even", tuple(made), finger, (screen,)).make(tmp_path).sidecars
    ground = tables[0]["predicted"]["mu_without_voltage"]
    for table in tables:
        assert table["friction"]["mean"] == pytest.approx(1.1 * ground, rel=1e-6)
    # A sine's own: amplitude over sqrt(2), and (highest - lowest) / (their sum).
    assert tables[1]["friction"]["rms_change"] == pytest.approx(0.05 * ground / 2**0.5, rel=1e-3)
    assert tables[1]["friction"]["depth"] == pytest.approx(0.05 / 1.1, rel=1e-3)
    for name in ("theory", "terms", "x", "dose", "pull_past_breakdown", "current"):
        assert name in tables[0]
    drive = tables[1]["rms_v"] ** 2 * tables[1]["length_s"]
    assert tables[1]["dose"]["square_voltage_v2_s"] == pytest.approx(drive)
    with pytest.raises(InputError, match="one quantity"):
        equal_mean([Stimulus("v", Sine(9.0, 9.0).lasting(0.1), "volts")], 1.0)


def test_a_level_that_is_not_possible_is_answered_by_one_that_is():
    known, limits = Perception.default(), DriveLimits(ceiling_v=100.0)
    # By hand: 40 dB re 1 V under the ceiling, less the highest threshold, 25.8 dB at 160 Hz.
    highest, at = highest_level([160.0, 360.0], "direct", 4000.0, known, limits)
    assert highest == pytest.approx(40 - 25.8) and at == 160.0
    carried, _ = highest_level([360.0], "carrier", 4000.0, known, limits)
    assert carried == pytest.approx(40 - 18.8 - 10 * np.log10(2))
    with pytest.raises(InputError, match=r"30 dB .*14\.2 dB.*160 Hz"):
        matched_intensity("m", [160.0, 360.0], 30.0, 1.0, limits=limits)
    made = matched_intensity("m", [160.0, 360.0], 14.1, 0.5, limits=limits, fade_s=0.0)
    peaks = [np.abs(one.signal.values(0, 24_000, RATE)).max() for one in made]
    assert 95 < max(peaks) <= 100


@pytest.mark.parametrize("samples", [4800, 1000])
@pytest.mark.parametrize("number", [1, 2, 256, 511])  # codes 1 1, 1 2, 2 2 and 3 3
def test_a_recorder_gets_both_pulses_of_an_onset(number, samples):
    """It takes each change to a code but 0 as an event."""
    trigger = Trigger(number, samples, RATE, 2)
    level = np.rint(trigger.values(0, samples) * 256).astype(int)
    begins = np.flatnonzero(np.diff(level, prepend=0))
    *onset, end = [int(level[at]) for at in begins if level[at]]
    assert (onset[0] - 1) * 254 + onset[1] == number and len(onset) == 2 and end == 255
    lengths = np.diff([*begins, samples])[level[begins] > 0]
    assert trigger.describe()["pulse_s"] == pytest.approx(lengths / RATE)


def test_triggers_tell_more_than_254_apart():
    assert [pulses(count) for count in (1, CODES, CODES + 1, CODES**2)] == [1, 1, 2, 2]
    with pytest.raises(InputError, match="several sets"):
        pulses(CODES**2 + 1)
    codes = {Trigger(n, 4800, RATE, 2).onset_codes for n in range(1, 1000)}
    assert len(codes) == 999
    levels = Trigger(300, 4800, RATE, 2).values(0, 4800) * 256
    a, b = levels[10], levels[970]
    assert (a - 1) * 254 + b == 300 and not levels[1440:-480].any() and levels[-1] == 255
    cut = np.concatenate([Trigger(300, 4800, RATE, 2).values(k, 96) for k in range(0, 4800, 96)])
    np.testing.assert_array_equal(cut * 256, levels)
    many = [Stimulus(f"s{n}", Sine(0.1, 20.0).lasting(0.1)) for n in range(300)]
    table, columns = events(many, [one.name for one in many], TrialPlan(seed=None))
    told = [row.split("\t")[4] for row in table.splitlines()[1:]]
    assert told == [str(n) for n in range(1, 301)]
    assert "254" in columns["trigger"]["Description"]


def test_a_sidecar_makes_its_file_again(finger, screen, tmp_path, own_cache):
    stimuli = (noise(5), Stimulus("tone", Sine(70.0, 9.0).lasting(0.1), "volts"))
    made = StimulusSet("set", stimuli, finger, (screen,), container="flac", encoding="24-bit")
    made.make(tmp_path / "set")
    for name in ("n5", "tone"):
        again = make_again(tmp_path / "set" / f"{name}.json", tmp_path / f"{name}.flac")
        assert again.read_bytes() == (tmp_path / "set" / f"{name}.flac").read_bytes()
    with pytest.raises(InputError, match="is there already"):
        make_again(tmp_path / "set" / "n5.json", tmp_path / "n5.flac")
    table = json.loads((tmp_path / "set" / "n5.json").read_text())
    table["stimulus"]["signal"]["of"]["seed"] = 6
    (tmp_path / "set" / "n5.json").write_text(json.dumps(table))
    with pytest.raises(InputError, match="its samples differ"):
        make_again(tmp_path / "set" / "n5.json", tmp_path / "other.flac")
    assert not list(tmp_path.glob("*other.flac*"))
    with pytest.raises(HaptixError, match=r"no\.json"):
        make_again(tmp_path / "set" / "no.json", tmp_path / "other.flac")


def test_a_participants_own_path(tmp_path):
    (tmp_path / "path.csv").write_text("t_s,x_mm,y_mm\n4.0,1,0\n5.0,10,0\n5.5,30,0\n6.5,20,0\n")
    path = speed_from({"kind": "recorded-path", "file": str(tmp_path / "path.csv"), "start_s": 5})
    np.testing.assert_allclose(path.position_mm(np.array([0, 0.25, 1.0])), [10, 20, 25])
    with pytest.raises(InputError, match="two places"):
        speed_from({"kind": "recorded-path", "file": str(tmp_path / "path.csv"), "start_s": 6})


def test_recipes_have_them_all(tmp_path):
    (tmp_path / "path.csv").write_text("t_s,x_mm\n0,0\n1,80\n")
    (tmp_path / "set.toml").write_text(
        """
        name = "all"
        [[designs]]
        kind = "equal-mean-friction"
        name = "even"
        mean = 0.1
        variants = 2
        base = { length_s = 0.1, signal = { kind = "time-noise", deviation = 0.01,
                 frequency_hz = [10, 200], seed = 1, exponent = 1.0 } }
        factors = { "signal.exponent" = [0.5, 1.0] }
        [stimuli.own]
        length_s = 0.1
        speed = { kind = "recorded-path", file = "path.csv" }
        signal = { kind = "grating", amplitude = 0.02, offset = 0.05, period_mm = 2 }
        """.replace("\n                 ", " ")
    )
    made = {one.name: one for one in Recipe.load(tmp_path / "set.toml").stimulus_set().stimuli}
    assert set(made) == {"own", "even-01-v1", "even-01-v2", "even-02-v1", "even-02-v2"}
    assert made["own"].speed.position_mm(np.array([0.5])) == pytest.approx(40)
    assert made["even-02-v2"].signal.values(0, 4800, RATE).mean() == pytest.approx(0.1)
    assert set(made["even-02-v2"].conditions) == {"signal.exponent", "variant", "shift"}


@pytest.mark.parametrize(
    ("chosen", "jnd"), [("", 0.11), ("samur-2009", 0.18), ("own.toml", 0.3), ("nobody", None)]
)
def test_a_jnd_is_chosen_by_its_name_or_file(tmp_path, monkeypatch, chosen, jnd):
    text = Perception.default().model_dump(mode="json", exclude_none=True)
    text["difference"]["weber_fraction"] = 0.3
    Perception(**text).save(tmp_path / "own.toml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HAPTIX_PERCEPTION", chosen)
    read = Perception.default.__wrapped__
    if jnd is None:
        with pytest.raises(InputError, match=r"HAPTIX_PERCEPTION: JND: .*samur-2009"):
            read(Perception)
    else:
        assert read(Perception).weber_fraction == jnd


@pytest.mark.slow  # a process of its own, with torch
def test_one_jnd_reaches_tolerances_plans_and_verdicts():
    code = (
        "import inspect, torch\n"
        "from haptix.model.perception.thresholds import WEBER_FRACTION\n"
        "from haptix.plan.planning import Effect\n"
        "from haptix.model.surface.tolerance import Tolerance\n"
        "from haptix.play.virtual_finger.felt import evaluate\n"
        "mu = torch.tensor([0.5])\n"
        "unit = Tolerance.read('1 JND').unit_in_mu(mu, 0.1, 0.9)\n"
        "verdict = inspect.signature(evaluate).parameters['weber_fraction'].default\n"
        "effect = Effect.between(mu, mu * 1.1).jnd_max\n"
        "print(WEBER_FRACTION, float(unit) / 0.5, verdict, 0.1 / effect)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True,
        env=os.environ | {"HAPTIX_PERCEPTION": "samur-2009"},
    )  # fmt: skip
    assert [float(one) for one in done.stdout.split()] == pytest.approx([0.18] * 4, rel=1e-5)
