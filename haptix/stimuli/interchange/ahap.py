"""AHAP, the haptic patterns of Apple's Core Haptics: intensity against time.

The file keeps the share of a friction range against time, as the intensity of one continuous
event. Volts, force, carrier, absolute friction and everything in space are lost. Curves are kept at
their corners only. Sharpness has no counterpart in friction and stays constant.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from haptix.checks import number
from haptix.errors import FileFormatError, InputError
from haptix.files import json_text, read_json, reading, write_whole
from haptix.signals.in_time import Points
from haptix.signals.signal import Signal

_CORNERS_PER_CURVE = 16  # more in one are not played by every version of Core Haptics
_LONGEST_EVENT_S = 30.0  # of a continuous event
_SHARPNESS = 0.5


def write_ahap(
    path: str | Path, signal: Signal, low: float, high: float, rate_hz: float = 200.0
) -> dict[str, Any]:
    """Write a finite signal; `low` becomes intensity 0 and `high` becomes 1.

    Values outside are an error. There are `rate_hz` corners per second.

    Returns
    -------
    dict
        What is lost: ``lost`` in words, ``rms`` and ``largest`` of what the corners miss.
    """
    if number("high", high) <= number("low", low):
        raise InputError(f"low and high: expected low < high, got {low:g} and {high:g}")
    length = signal.length_s
    if not 0 < length <= _LONGEST_EVENT_S:
        raise InputError(
            f"signal: a continuous event lasts at most {_LONGEST_EVENT_S:g} s, got {length:g} s"
        )
    fine_hz = max(48_000.0, 4 * rate_hz)
    count = signal.samples(fine_hz) or 1
    values = signal.values(0, count, fine_hz)
    if values.min() < low - 1e-9 * (high - low) or values.max() > high + 1e-9 * (high - low):
        raise InputError(
            f"signal: reaches {values.min():g} to {values.max():g}, outside {low:g} to {high:g}"
        )
    t = np.arange(count) / fine_hz
    at = np.unique(np.append(np.arange(0, length, 1 / rate_hz), (count - 1) / fine_hz))
    corner = np.clip((np.interp(at, t, values) - low) / (high - low), 0, 1)
    full = [
        {"ParameterID": "HapticIntensity", "ParameterValue": 1.0},
        {"ParameterID": "HapticSharpness", "ParameterValue": _SHARPNESS},
    ]
    event = {
        "Time": 0.0, "EventType": "HapticContinuous", "EventDuration": length,
        "EventParameters": full,
    }  # fmt: skip
    pattern: list[dict[str, Any]] = [{"Event": event}]
    # Curves share their ends, so that no straight line is lost between two of them.
    for first in range(0, max(1, len(at) - 1), _CORNERS_PER_CURVE - 1):
        part = slice(first, first + _CORNERS_PER_CURVE)
        begin = float(at[first])
        points = [
            {"Time": float(x) - begin, "ParameterValue": float(y)}
            for x, y in zip(at[part], corner[part], strict=True)
        ]
        curve = {
            "ParameterID": "HapticIntensityControl", "Time": begin,
            "ParameterCurveControlPoints": points,
        }  # fmt: skip
        pattern.append({"ParameterCurve": curve})
    missed = low + np.interp(t, at, corner) * (high - low) - values
    lost = {
        "lost": (
            "volts, force, carrier, absolute friction and places; what is between corners "
            f"{1 / rate_hz:g} s apart"
        ),
        "rms": float(np.sqrt(np.mean(missed**2))),
        "largest": float(np.abs(missed).max()),
    }
    description = f"intensity 0 to 1 is {low:g} to {high:g}; {lost['lost']}"
    metadata = {"Project": "haptix", "Description": description}
    table = {"Version": 1.0, "Metadata": metadata, "Pattern": pattern}
    write_whole(path, json_text(table))
    return lost


def read_ahap(path: str | Path, low: float, high: float) -> tuple[Signal, list[str]]:
    """Read the intensity of a pattern's continuous events; intensity 0 and 1 become low and high.

    Returns intensity times its control curve, as straight lines between corners, and what of the
    file is not in it.

    Raises
    ------
    FileFormatError
        If it is no AHAP, or has no continuous event.
    """
    path = Path(path)
    table = read_json(path)
    with reading(path, "an AHAP pattern"):
        events = [one["Event"] for one in table["Pattern"] if "Event" in one]
        curves = [one["ParameterCurve"] for one in table["Pattern"] if "ParameterCurve" in one]
        lasting = [one for one in events if one["EventType"] == "HapticContinuous"]
        spans = [
            (float(one["Time"]), float(one["Time"]) + float(one["EventDuration"]), _intensity(one))
            for one in lasting
        ]
        corners = sorted(
            (float(curve["Time"]) + float(point["Time"]), float(point["ParameterValue"]))
            for curve in curves
            if curve["ParameterID"] == "HapticIntensityControl"
            for point in curve["ParameterCurveControlPoints"]
        )
        control = sorted({one["ParameterID"] for one in curves} - {"HapticIntensityControl"})
    if not spans:
        raise FileFormatError(f"{path}: has no HapticContinuous event, only those can be friction")
    lost = []
    others = len(events) - len(lasting)
    if others:
        lost.append(f"{others} events that are not HapticContinuous")
    if any("HapticSharpness" in json.dumps(one) for one in lasting):
        lost.append("sharpness, which friction does not have")
    lost += [f"curves of {name}" for name in control]
    return _drawn(spans, corners, low, high), lost


def _intensity(event: dict[str, Any]) -> float:
    for parameter in event.get("EventParameters", []):
        if parameter["ParameterID"] == "HapticIntensity":
            return min(max(float(parameter["ParameterValue"]), 0.0), 1.0)
    return 1.0


def _drawn(
    spans: list[tuple[float, float, float]],
    corners: list[tuple[float, float]],
    low: float,
    high: float,
) -> Signal:
    """Lines between the corners of the events and curves; before a curve its factor is 1."""
    tiny = 1e-6  # an edge takes this long [s]
    end = max(stop for _, stop, _ in spans)
    edges = {0.0, end, *(t for t, _ in corners if 0 <= t <= end)}
    for begin, stop, _ in spans:
        edges |= {begin, max(0.0, begin - tiny), stop, max(0.0, stop - tiny)}
    t = np.array(sorted(edges))
    loudest = np.zeros(len(t))
    for begin, stop, level in spans:
        inside = (t >= begin) & ((t < stop) | (t == end) & (stop == end))
        loudest[inside] = np.maximum(loudest[inside], level)
    if corners:
        loudest *= np.interp(t, [x for x, _ in corners], [y for _, y in corners], left=1.0)
    values = low + (high - low) * np.clip(loudest, 0.0, 1.0)
    return Points(tuple(t.tolist()), tuple(values.tolist()))
