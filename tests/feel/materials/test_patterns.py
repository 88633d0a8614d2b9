"""Patterns of other programs as materials: what of them is friction, or what else they are."""

import json

import numpy as np
import pytest

from haptix.base.errors import FileFormatError, InputError
from haptix.feel.materials import load
from haptix.feel.materials.patterns import NotFeltWarning
from haptix.feel.materials.timeline import Transient
from haptix.feel.motion import Motion
from haptix.feel.signals.shapes import Ramp
from haptix.lab.stimuli.interchange import write_ahap, write_hjif

CLIP = {
    "version": {"major": 1, "minor": 0, "patch": 0},
    "metadata": {"editor": "Meta Haptics Studio"},
    "signals": {"continuous": {"envelopes": {
        "amplitude": [
            {"time": 0.0, "amplitude": 0.0},
            {"time": 0.1, "amplitude": 0.8, "emphasis": {"amplitude": 1.0, "frequency": 0.5}},
            {"time": 0.3, "amplitude": 0.2},
        ],
        "frequency": [{"time": 0.0, "frequency": 0.4}],
    }}},
}  # fmt: skip


def test_hjif_of_friction_is_a_recording(tmp_path):
    write_hjif(tmp_path / "a.hjif", [0.0, 5.0, 20.0], [0.2, 0.4, 0.3])
    material = load(tmp_path / "a.hjif")
    assert material.kind == "recording" and material.evaluator.target == "mu"
    wanted = material.wanted(Motion.of(np.array([0.0, 2.5, 5.0, 12.5]), 0.0))
    np.testing.assert_allclose(wanted, [0.2, 0.3, 0.4, 0.35], atol=1e-9)
    material.save(tmp_path / "m.toml")
    assert load(tmp_path / "m.toml") == material


def test_ahap_is_a_transient_of_shares(tmp_path):
    write_ahap(tmp_path / "a.ahap", Ramp(0.2, 0.6, 0.5), 0.2, 0.6)
    with pytest.warns(NotFeltWarning, match="sharpness"):
        material = load(tmp_path / "a.ahap")
    assert isinstance(material, Transient) and material.begins == "down"
    curve = material.curve
    assert curve.values(0, 3, 5.0)[1] == pytest.approx(0.4, abs=0.01)
    assert curve.length_s == pytest.approx(0.5, abs=1e-3)
    material.save(tmp_path / "m.toml")
    assert load(tmp_path / "m.toml") == material


def test_a_haptic_clip_is_its_amplitude(tmp_path):
    (tmp_path / "a.haptic").write_text(json.dumps(CLIP))
    with pytest.warns(NotFeltWarning, match="emphasis, frequency"):
        material = load(tmp_path / "a.haptic")
    assert isinstance(material, Transient)
    values = material.curve.values(0, 4, 10.0)
    np.testing.assert_allclose(values[:3], [0.0, 0.8, 0.5], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.tact", '{"project": {"tracks": []}}', "vest or sleeve"),
        ("a.hjif", '{"perceptions": [{"perception_modality": "Vibrotactile"}]}', "Vibrotactile"),
        (
            "a.ahap",
            '{"Pattern": [{"Event": {"EventType": "HapticTransient"}}]}',
            "HapticContinuous",
        ),
        ("a.haptic", '{"signals": {}}', "haptic clip"),
        ("a.haptic", "RIFF", "JSON"),
    ],
)
def test_what_is_no_friction_is_told(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises((FileFormatError, InputError), match=rf"{name}.*{said}"):
        load(tmp_path / name)
