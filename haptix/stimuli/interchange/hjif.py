"""MPEG haptics, ISO/IEC 23090-31, in its JSON form (HJIF): friction along a line on the screen.

The standard's modality "Friction" lies in space: positions are in metres times ten to the
``unit_exponent``, and a signal of -1 to 1 per position. One band of straight lines ("Curve",
"Linear") keeps a profile of friction; mu is written unchanged, and must be at most 1. Field names
and their order follow the reference software of the standard (MPEGGroup/HapticReferenceSoftware).

Lost: volts, force, speed, carrier, and what lies between the corners; positions are whole units.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from haptix.checks import increasing, row
from haptix.errors import FileFormatError, InputError
from haptix.files import json_text, read_json, reading, write_whole
from haptix.stimuli.along_path import AlongPath, SpeedProfile, relief

UNIT_EXPONENT = -6
"""Micrometres: finer than any finger, and 2 km of them in the standard's integers."""

_DEFAULT_EXPONENT = -3  # of the standard, for files without one


def write_hjif(
    path: str | Path,
    x_mm: Sequence[float],
    mu: Sequence[float],
    description: str = "friction along a line",
    date: str | None = None,
) -> dict[str, Any]:
    """Write a profile of friction coefficients along a line.

    Parameters
    ----------
    path : path
        The file.
    x_mm, mu : sequence of float
        Places of the corners [mm], 0 or more, increasing; friction there, 0 to 1.
    description, date : str
        Text and date for the file's head; the date is in ISO 8601, by default today's.

    Returns
    -------
    dict
        What is lost: in words, and ``largest_shift_mm`` of a corner.
    """
    places, values = increasing("x_mm", x_mm, 2).tolist(), row("mu", mu, 2).tolist()
    if len(places) != len(values):
        raise InputError(f"mu: expected one value for each of the {len(places)} corners")
    if places[0] < 0 or min(values) < 0 or max(values) > 1:
        raise InputError(
            "x_mm and mu: expected places of 0 mm or more and friction of 0 to 1, which is what "
            "the format holds"
        )
    unit_mm = 10.0 ** (UNIT_EXPONENT + 3)
    whole = [round(x / unit_mm) for x in places]
    if len(set(whole)) < len(whole):
        raise InputError(f"x_mm: corners less than {unit_mm:g} mm apart fall together")
    keyframes = [
        {"relative_position": at - whole[0], "amplitude_modulation": value}
        for at, value in zip(whole, values, strict=True)
    ]
    effect = {
        "effect_type": "Basis", "position": whole[0], "phase": 0.0, "base_signal": "Sine",
        "keyframes": keyframes,
    }  # fmt: skip
    band = {
        "band_type": "Curve", "curve_type": "Linear", "lower_frequency_limit": 0,
        "upper_frequency_limit": 1000, "effects": [effect],
    }  # fmt: skip
    channel = {
        "id": 0, "description": "along the line", "gain": 1.0, "mixing_coefficient": 1.0,
        "body_part_mask": 0, "bands": [band],
    }  # fmt: skip
    perception = {
        "id": 0, "avatar_id": 0, "description": description, "perception_modality": "Friction",
        "unit_exponent": UNIT_EXPONENT, "perception_unit_exponent": 0, "reference_devices": [],
        "effect_library": [], "channels": [channel],
    }  # fmt: skip
    table = {
        "version": "2025",  # year of the standard
        "profile": "Main", "level": 2,
        "date": datetime.now(UTC).date().isoformat() if date is None else date,
        "description": f"{description}; amplitude is the friction coefficient", "timescale": 1000,
        "avatars": [],  # a perception of avatar 0 is that of none in particular
        "perceptions": [perception], "syncs": [],
    }  # fmt: skip
    write_whole(path, json_text(table))
    return {
        "lost": "volts, force, speed and carrier; friction is straight between corners",
        "largest_shift_mm": max(abs(a * unit_mm - b) for a, b in zip(whole, places, strict=True)),
    }


def read_hjif(path: str | Path, speed: SpeedProfile | float) -> tuple[AlongPath, list[str]]:
    """Read the first profile of friction in a file, and say what of the file is not in it.

    The file does not contain the finger's motion, which `speed` gives; a number is in mm/s.

    Raises
    ------
    FileFormatError
        If it is no HJIF, or holds no curve of friction.
    """
    path = Path(path)
    table = read_json(path)
    lost: list[str] = []
    with reading(path, "HJIF"):
        perceptions = table["perceptions"]
        friction = [one for one in perceptions if one["perception_modality"] == "Friction"]
        if not friction:
            kinds = sorted({one["perception_modality"] for one in perceptions})
            raise FileFormatError(
                f"{path}: expected a perception of the modality Friction, got "
                f"{', '.join(kinds) or 'none'}"
            )
        first = friction[0]
        channel = first["channels"][0]
        bands = [band for band in channel["bands"] if band["band_type"] == "Curve"]
        if not bands:
            raise FileFormatError(f"{path}: expected a band of curves, which is what is read")
        for what, there in (
            ("perceptions", perceptions), ("channels", first["channels"]),
            ("bands", channel["bands"]),
        ):  # fmt: skip
            if len(there) > 1:
                lost.append(f"{len(there) - 1} other {what}")
        if bands[0].get("curve_type", "Linear") != "Linear":
            lost.append(f"the shape of curve {bands[0]['curve_type']!r}: read as straight lines")
        unit_mm = 1e3 * 10.0 ** int(first.get("unit_exponent", _DEFAULT_EXPONENT))
        scale = 10.0 ** int(first.get("perception_unit_exponent", 0))
        gain = float(channel.get("gain", 1.0)) * scale
        corners: dict[float, float] = {}
        for effect in bands[0]["effects"]:
            if effect["effect_type"] != "Basis":
                lost.append(f"an effect of type {effect['effect_type']!r}")
                continue
            for frame in effect["keyframes"]:
                at = (int(effect["position"]) + int(frame["relative_position"])) * unit_mm
                if "amplitude_modulation" in frame:
                    corners[at] = float(frame["amplitude_modulation"]) * gain
    x = sorted(corners)
    if len(x) < 2:
        raise FileFormatError(f"{path}: expected two corners of friction or more, got {len(x)}")
    return relief(tuple(x), tuple(corners[at] for at in x), speed), lost
