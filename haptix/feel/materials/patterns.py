"""Haptic patterns of other programs: what of them is friction on a screen.

AHAP (Core Haptics) and ``.haptic`` (Meta Haptics Studio, Lofelt) hold the intensity of a vibration
against time. Here it is a share of the reachable friction, from the touch on. HJIF (MPEG haptics)
holds friction along a line where its modality is "Friction". Patterns for the motors of vests and
sleeves (``.tact``) have no counterpart.
"""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from haptix.base.checks import Array
from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import read_json, reading
from haptix.feel.signals.shapes import Points

SUFFIXES = (".ahap", ".haptic", ".hjif", ".tact")
"""Ends of the names of such files."""

_UNIT_EXPONENT = -3  # of HJIF, for files without one
_TINY_S = 1e-6  # an edge takes this long


class NotFeltWarning(UserWarning):
    """A part of a file or a model cannot be felt on a screen; the message names it."""


def fields_of(path: Path) -> dict[str, Any]:
    """Return the fields of the material that a pattern is.

    Raises
    ------
    FileFormatError
        If the file cannot be read, or holds nothing that is friction.
    InputError
        If its kind of pattern has no counterpart on a screen.
    """
    if path.suffix == ".hjif":
        _warn(path, hjif_profile(path)[2])
        return {"kind": "recording", "file": path.name}
    if path.suffix == ".tact":
        read_json(path)
        raise InputError(
            "is a pattern of bHaptics: intensities of the motors of a vest or sleeve, which have "
            "no place on a screen; play its sound as a transient, or draw its course as points"
        )
    t_s, share, lost = ahap_intensity(path) if path.suffix == ".ahap" else clip_amplitude(path)
    _warn(path, lost)
    curve = Points(tuple(t_s.tolist()), tuple(share.tolist())).describe()
    return {"kind": "transient", "curve": curve}


def _warn(path: Path, lost: list[str]) -> None:
    if lost:
        warnings.warn(f"{path}: not felt: {', '.join(lost)}", NotFeltWarning, stacklevel=4)


def ahap_intensity(path: Path) -> tuple[Array, Array, list[str]]:
    """Times [s], intensities of 0 to 1, and what else the file holds.

    Raises
    ------
    FileFormatError
        If it is no AHAP, or has no continuous event.
    """
    table = read_json(path)
    with reading(path, "an AHAP pattern"):
        events = [entry["Event"] for entry in table["Pattern"] if "Event" in entry]
        curves = [
            entry["ParameterCurve"] for entry in table["Pattern"] if "ParameterCurve" in entry
        ]
        lasting = [event for event in events if event["EventType"] == "HapticContinuous"]
        spans = [
            (
                float(event["Time"]),
                float(event["Time"]) + float(event["EventDuration"]),
                _intensity(event),
            )
            for event in lasting
        ]
        corners = sorted(
            (float(curve["Time"]) + float(point["Time"]), float(point["ParameterValue"]))
            for curve in curves
            if curve["ParameterID"] == "HapticIntensityControl"
            for point in curve["ParameterCurveControlPoints"]
        )
        control = sorted({curve["ParameterID"] for curve in curves} - {"HapticIntensityControl"})
    if not spans:
        raise FileFormatError(f"{path}: has no HapticContinuous event, only those can be friction")
    lost = []
    others = len(events) - len(lasting)
    if others:
        lost.append(f"{others} events that are not HapticContinuous")
    if any("HapticSharpness" in json.dumps(event) for event in lasting):
        lost.append("sharpness, which friction does not have")
    lost += [f"curves of {name}" for name in control]
    return *_drawn(spans, corners), lost


def _intensity(event: dict[str, Any]) -> float:
    for parameter in event.get("EventParameters", []):
        if parameter["ParameterID"] == "HapticIntensity":
            return min(max(float(parameter["ParameterValue"]), 0.0), 1.0)
    return 1.0


def _drawn(
    spans: list[tuple[float, float, float]], corners: list[tuple[float, float]]
) -> tuple[Array, Array]:
    """Lines between the corners of the events and curves; before a curve its factor is 1."""
    end = max(stop for _, stop, _ in spans)
    edges = {0.0, end, *(t for t, _ in corners if 0 <= t <= end)}
    for begin, stop, _ in spans:
        edges |= {begin, max(0.0, begin - _TINY_S), stop, max(0.0, stop - _TINY_S)}
    t = np.array(sorted(edges))
    loudest = np.zeros(len(t))
    for begin, stop, level in spans:
        inside = (t >= begin) & ((t < stop) | (t == end) & (stop == end))
        loudest[inside] = np.maximum(loudest[inside], level)
    if corners:
        loudest *= np.interp(t, [x for x, _ in corners], [y for _, y in corners], left=1.0)
    return t, np.clip(loudest, 0.0, 1.0)


def clip_amplitude(path: Path) -> tuple[Array, Array, list[str]]:
    """Times [s] and amplitudes of 0 to 1 of a ``.haptic`` clip, and what else it holds.

    Raises
    ------
    FileFormatError
        If it is no such clip, or has no two corners.
    """
    table = read_json(path)
    with reading(path, "a haptic clip of Meta Haptics Studio"):
        envelopes = table["signals"]["continuous"]["envelopes"]
        corners = {float(c["time"]): float(c["amplitude"]) for c in envelopes["amplitude"]}
        has_emphasis = any("emphasis" in corner for corner in envelopes["amplitude"])
        has_frequency = bool(envelopes.get("frequency"))
    if len(corners) < 2:
        raise FileFormatError(f"{path}: expected two corners of amplitude or more")
    t_s = np.array(sorted(corners))
    lost = ["emphasis"] * has_emphasis + ["frequency, which friction does not have"] * has_frequency
    return t_s - t_s[0], np.clip([corners[t] for t in t_s], 0.0, 1.0), lost


def hjif_profile(path: Path) -> tuple[list[float], list[float], list[str]]:
    """Places [mm] and friction of the first profile of friction in a file, and what else it holds.

    Raises
    ------
    FileFormatError
        If it is no HJIF, or holds no curve of friction.
    """
    table = read_json(path)
    lost: list[str] = []
    with reading(path, "HJIF"):
        perceptions = table["perceptions"]
        friction = [
            perception
            for perception in perceptions
            if perception["perception_modality"] == "Friction"
        ]
        if not friction:
            kinds = sorted({perception["perception_modality"] for perception in perceptions})
            raise FileFormatError(
                f"{path}: expected a perception of the modality Friction, got "
                f"{', '.join(kinds) or 'none'}"
            )
        first = friction[0]
        channel = first["channels"][0]
        bands = [band for band in channel["bands"] if band["band_type"] == "Curve"]
        if not bands:
            raise FileFormatError(f"{path}: expected a band of curves, the only kind that is read")
        for what, there in (
            ("perceptions", perceptions), ("channels", first["channels"]),
            ("bands", channel["bands"]),
        ):  # fmt: skip
            if len(there) > 1:
                lost.append(f"{len(there) - 1} other {what}")
        if bands[0].get("curve_type", "Linear") != "Linear":
            lost.append(f"the shape of curve {bands[0]['curve_type']!r}: read as straight lines")
        unit_mm = 1e3 * 10.0 ** int(first.get("unit_exponent", _UNIT_EXPONENT))
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
    return x, [corners[at] for at in x], lost
