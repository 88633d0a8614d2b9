"""Interchange: there and back, the stated loss, foreign files, and what is refused."""

import json
import re
from itertools import pairwise

import numpy as np
import pytest
from skimage.io import imsave

from haptix.base.errors import HaptixError, InputError
from haptix.feel import AlongPath, Chirp, Constant, Ramp, Sine, Step
from haptix.feel.materials import RecordedProfile
from haptix.lab.stimuli.interchange import FrictionMap, read_ahap, read_hjif, write_ahap, write_hjif

RATE = 48_000.0


def test_friction_maps_lose_their_sixteen_bits(tmp_path, rng):
    """Columns and rows stay where they are, and values to half a step."""
    values = 0.25 + 0.1 * rng.random((17, 31))
    FrictionMap(values, 40.0).save(tmp_path / "map.png")
    again = FrictionMap.load(tmp_path / "map.png")
    assert (again.width_mm, again.quantity, again.values.shape) == (40.0, "mu", (17, 31))
    step = np.ptp(values) / 65535
    assert np.abs(again.values - values).max() <= step / 2 * (1 + 1e-9)
    said = json.loads((tmp_path / "map.json").read_text())
    assert "at most" in said["lost"] and said["orientation"] == "x to the right, y downwards"
    flat = FrictionMap(np.full((2, 2), 0.3), 1.0, "contrast")
    flat.save(tmp_path / "flat.png")
    assert np.array_equal(FrictionMap.load(tmp_path / "flat.png").values, flat.values)


def test_wrong_maps_are_refused(tmp_path):
    grey = FrictionMap(np.arange(6.0).reshape(2, 3), 5.0)
    grey.save(tmp_path / "a.png")
    imsave(tmp_path / "a.png", np.zeros((2, 3), np.uint16), check_contrast=False)
    with pytest.raises(HaptixError, match="not the picture"):
        FrictionMap.load(tmp_path / "a.png")
    imsave(tmp_path / "a.png", np.zeros((2, 3), np.uint8), check_contrast=False)
    with pytest.raises(HaptixError, match="16-bit"):
        FrictionMap.load(tmp_path / "a.png")
    (tmp_path / "a.png").write_text("no picture")
    with pytest.raises(HaptixError, match="not an image"):
        FrictionMap.load(tmp_path / "a.png")
    (tmp_path / "a.json").write_text('{"black_is": 0}')
    with pytest.raises(HaptixError, match="white_is"):
        FrictionMap.load(tmp_path / "a.png")
    (tmp_path / "a.json").unlink()
    with pytest.raises(HaptixError, match=r"a\.json"):
        FrictionMap.load(tmp_path / "a.png")
    for values, width in ((np.full((2, 2), np.nan), 1.0), (np.zeros(3), 1.0), (np.eye(2), 0.0)):
        with pytest.raises(InputError):
            FrictionMap(values, width)


@pytest.mark.parametrize(
    "signal",
    [Ramp(0.1, 0.4, 0.5), (Sine(0.1, 8.0) + 0.2).lasting(0.6), Step(0.1, 0.3, 0.2, 0.4)],
    ids=["ramp", "sine", "step"],
)
def test_ahap_keeps_what_it_says(tmp_path, signal):
    lost = write_ahap(tmp_path / "a.ahap", signal, 0.0, 0.5)
    again, said = read_ahap(tmp_path / "a.ahap", 0.0, 0.5)
    assert again.length_s == pytest.approx(signal.length_s)
    count = signal.samples(RATE)
    error = again.values(0, count - 2, RATE) - signal.values(0, count - 2, RATE)
    assert np.abs(error).max() <= lost["largest"] + 1e-6
    assert np.sqrt(np.mean(error**2)) == pytest.approx(lost["rms"], rel=0.05, abs=1e-6)
    assert said == ["sharpness, which friction does not have"]
    assert "volts" in lost["lost"]


def test_ahap_is_of_the_form_that_core_haptics_reads(tmp_path):
    """Keys, times from a curve's own start, 16 corners at most, intensities of 0 to 1."""
    write_ahap(tmp_path / "a.ahap", Chirp(0.2, 1.0, 30.0, 3.0, offset=0.2), 0.0, 0.4)
    table = json.loads((tmp_path / "a.ahap").read_text())
    assert table["Version"] == 1.0
    (event,) = [one["Event"] for one in table["Pattern"] if "Event" in one]
    assert event["EventType"] == "HapticContinuous" and event["EventDuration"] == 3.0
    curves = [one["ParameterCurve"] for one in table["Pattern"] if "ParameterCurve" in one]
    ends = []
    for curve in curves:
        points = curve["ParameterCurveControlPoints"]
        assert curve["ParameterID"] == "HapticIntensityControl"
        assert 2 <= len(points) <= 16 and points[0]["Time"] == 0
        assert all(0 <= point["ParameterValue"] <= 1 for point in points)
        ends.append((curve["Time"], curve["Time"] + points[-1]["Time"]))
    assert all(a[1] == pytest.approx(b[0]) for a, b in pairwise(ends))


def test_a_foreign_ahap(tmp_path):
    """A tap, and a hum that fades: the tap is named as lost."""
    pattern = {
        "Version": 1.0,
        "Pattern": [
            {"Event": {"Time": 0.0, "EventType": "HapticTransient", "EventParameters": []}},
            {
                "Event": {
                    "Time": 0.1,
                    "EventType": "HapticContinuous",
                    "EventDuration": 0.4,
                    "EventParameters": [{"ParameterID": "HapticIntensity", "ParameterValue": 0.5}],
                }
            },
            {
                "ParameterCurve": {
                    "ParameterID": "HapticIntensityControl",
                    "Time": 0.1,
                    "ParameterCurveControlPoints": [
                        {"Time": 0.0, "ParameterValue": 1.0},
                        {"Time": 0.4, "ParameterValue": 0.0},
                    ],
                }
            },
        ],
    }
    (tmp_path / "a.ahap").write_text(json.dumps(pattern))
    signal, lost = read_ahap(tmp_path / "a.ahap", 0.2, 0.4)
    t = np.array([0.05, 0.11, 0.3, 0.49])
    found = [signal.values(round(at * RATE), 1, RATE)[0] for at in t]
    exact = [0.2, 0.2 + 0.2 * 0.5 * 0.975, 0.2 + 0.2 * 0.25, 0.2 + 0.2 * 0.5 * 0.025]
    assert found == pytest.approx(exact, abs=1e-4)
    assert lost == ["1 events that are not HapticContinuous"]


@pytest.mark.parametrize(
    ("call", "pattern"),
    [
        (lambda p: write_ahap(p, Constant(0.5), 0.0, 1.0), "at most 30 s"),
        (lambda p: write_ahap(p, Ramp(0.0, 2.0, 1.0), 0.0, 1.0), "outside 0 to 1"),
        (lambda p: write_ahap(p, Ramp(0.0, 1.0, 1.0), 1.0, 0.0), "low < high"),
        (lambda p: write_ahap("/dev/null/no", Ramp(0.0, 1.0, 1.0), 0.0, 1.0), "cannot write"),
        (lambda p: write_hjif(p, [0.0, 1.0], [0.2, 1.2]), "friction of 0 to 1"),
        (lambda p: write_hjif(p, [0.0, 1e-5], [0.2, 0.3]), "fall together"),
        (lambda p: write_hjif(p, [0.0], [0.2]), "at least 2"),
        (lambda p: write_hjif(p, [0.0, 1.0], [0.2, 0.3], date="today"), "ISO 8601"),
    ],
)
def test_what_cannot_be_exported_is_refused(tmp_path, call, pattern):
    with pytest.raises(HaptixError, match=pattern):
        call(tmp_path / "out")


def test_hjif_there_and_back(tmp_path):
    x, mu = [0.0, 1.5, 2.25, 10.0001], [0.25, 0.31, 0.27, 0.25]
    lost = write_hjif(tmp_path / "a.hjif", x, mu, date="2026-01-01")
    relief, said = read_hjif(tmp_path / "a.hjif", 50.0)
    assert isinstance(relief, AlongPath)
    assert isinstance(relief.field, RecordedProfile)
    assert relief.field.position_mm == pytest.approx(x, abs=lost["largest_shift_mm"] + 1e-12)
    assert lost["largest_shift_mm"] <= 0.5e-3
    assert relief.field.value == tuple(mu) and said == []
    write_hjif(tmp_path / "b.hjif", x, mu, date="2026-01-01")
    assert (tmp_path / "a.hjif").read_bytes() == (tmp_path / "b.hjif").read_bytes()


def test_hjif_has_what_the_reference_software_demands(tmp_path):
    """Members that its loader looks for, and the rules of its conformance check."""
    write_hjif(tmp_path / "a.hjif", [0.0, 1.0], [0.2, 0.3])
    table = json.loads((tmp_path / "a.hjif").read_text())
    assert set(table) >= {
        "version", "profile", "level", "date", "description", "timescale", "avatars",
        "perceptions", "syncs",
    }  # fmt: skip
    assert table["profile"] in ("Main", "Simple Parametric") and table["level"] in (1, 2)
    assert int(table["version"]) >= 2023
    # RFC 3339: the schema of the standard wants a date-time.
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(Z|[+-]\d\d:\d\d)", table["date"])
    assert all(avatar["id"] != 0 for avatar in table["avatars"])  # 0 is reserved
    (perception,) = table["perceptions"]
    assert perception["perception_modality"] == "Friction"
    assert perception["avatar_id"] == 0
    assert set(perception) >= {"id", "description", "channels", "effect_library"}
    (channel,) = perception["channels"]
    assert set(channel) >= {
        "id", "description", "gain", "mixing_coefficient", "body_part_mask", "bands",
    }  # fmt: skip
    (band,) = channel["bands"]
    assert isinstance(band["lower_frequency_limit"], int)
    (effect,) = band["effects"]
    assert set(effect) >= {"effect_type", "position", "phase", "base_signal", "keyframes"}
    for frame in effect["keyframes"]:
        assert isinstance(frame["relative_position"], int)
        assert -1 <= frame["amplitude_modulation"] <= 1


@pytest.mark.parametrize(("length_mm", "exponent"), [(60.0, -6), (65.54, -5), (310.0, -5)])
def test_positions_fit_the_sixteen_bits_of_the_binary_form(tmp_path, length_mm, exponent):
    x = np.linspace(2.0, 2.0 + length_mm, 41)
    lost = write_hjif(tmp_path / "a.hjif", x, np.linspace(0.2, 0.4, 41), date="2026-01-01")
    (perception,) = json.loads((tmp_path / "a.hjif").read_text())["perceptions"]
    (effect,) = perception["channels"][0]["bands"][0]["effects"]
    assert perception["unit_exponent"] == exponent
    assert max(frame["relative_position"] for frame in effect["keyframes"]) < 1 << 16
    relief, _ = read_hjif(tmp_path / "a.hjif", 50.0)
    assert isinstance(relief.field, RecordedProfile)
    assert relief.field.position_mm == pytest.approx(x, abs=lost["largest_shift_mm"] + 1e-9)
    assert lost["largest_shift_mm"] <= 0.5001 * 10.0 ** (exponent + 3)


def test_a_foreign_hjif(tmp_path):
    """Millimetres, a gain, and things that are not friction."""
    write_hjif(tmp_path / "a.hjif", [0.0, 1.0], [0.2, 0.3])
    table = json.loads((tmp_path / "a.hjif").read_text())
    perception = table["perceptions"][0]
    perception["unit_exponent"] = -3
    perception["channels"][0]["gain"] = 0.5
    frames = perception["channels"][0]["bands"][0]["effects"][0]["keyframes"]
    frames[1]["relative_position"] = 7
    table["perceptions"].insert(0, {"perception_modality": "Vibrotactile"})
    (tmp_path / "b.hjif").write_text(json.dumps(table))
    relief, lost = read_hjif(tmp_path / "b.hjif", 50.0)
    assert isinstance(relief.field, RecordedProfile)
    assert relief.field.position_mm == pytest.approx((0.0, 7.0))
    assert relief.field.value == pytest.approx((0.1, 0.15))
    assert lost == ["1 other perceptions"]


@pytest.mark.parametrize(
    ("text", "pattern"),
    [
        ("", "JSON"),
        ("[]", "object"),
        ("{}", "perceptions"),
        ('{"perceptions": [{"perception_modality": "Wind"}]}', "Friction.*Wind"),
        ('{"perceptions": [{"perception_modality": "Friction", "channels": []}]}', "HJIF"),
        (
            '{"perceptions": [{"perception_modality": "Friction", "channels": [{"bands": '
            '[{"band_type": "WaveletWave"}]}]}]}',
            "band of curves",
        ),
    ],
)
def test_wrong_hjif_and_ahap_are_refused(tmp_path, text, pattern):
    (tmp_path / "a.hjif").write_text(text)
    with pytest.raises(HaptixError, match=f"a.hjif.*{pattern}"):
        read_hjif(tmp_path / "a.hjif", 50.0)
    (tmp_path / "a.ahap").write_text(text)
    with pytest.raises(HaptixError, match=r"a\.ahap"):
        read_ahap(tmp_path / "a.ahap", 0.0, 1.0)
    (tmp_path / "b.ahap").write_text('{"Pattern": []}')
    with pytest.raises(HaptixError, match="no HapticContinuous"):
        read_ahap(tmp_path / "b.ahap", 0.0, 1.0)
