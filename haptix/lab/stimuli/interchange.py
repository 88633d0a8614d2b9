"""Haptic interchange: friction maps, AHAP and MPEG haptics (HJIF), each with its losses.

A friction map is friction over the screen as a 16-bit PNG, with a sidecar for the meaning of its
greys.

AHAP, the haptic patterns of Apple's Core Haptics, holds intensity against time: the share of a
friction range, as the intensity of one continuous event. Volts, force, carrier, absolute friction
and everything in space are lost. Curves are kept at their corners only. Sharpness has no
counterpart in friction and stays constant.

MPEG haptics, ISO/IEC 23090-31, in its JSON form (HJIF) holds friction along a line on the screen.
The standard's modality "Friction" lies in space: positions are in metres times ten to the
``unit_exponent``, and a signal of -1 to 1 per position. One band of straight lines ("Curve",
"Linear") keeps a profile of friction; mu is written unchanged, and must be at most 1. Field names
and their order follow the reference software of the standard (MPEGGroup/HapticReferenceSoftware).
Lost are volts, force, speed, carrier, and what lies between the corners; positions are whole units.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from haptix.base import checks
from haptix.base.checks import Array, increasing, number, row
from haptix.base.display import Displayed
from haptix.base.errors import FileFormatError, InputError, from_extra
from haptix.base.files import (
    LARGEST_PICTURE_BYTES,
    json_text,
    read_bytes,
    read_json,
    reading,
    write_folder,
    write_whole,
)
from haptix.feel.along_path import AlongPath, SpeedProfile, relief
from haptix.feel.materials.patterns import ahap_intensity, hjif_profile
from haptix.feel.signals.shapes import Points
from haptix.feel.signals.signal import Signal

MapQuantity = Literal["mu", "contrast"]

_WHITE = 65535


@dataclass(frozen=True, eq=False)
class FrictionMap(Displayed):
    """Friction over a rectangle, x to the right and y downwards from its corner."""

    values: Array
    """Friction, in the form of `quantity`; shape (rows, columns)."""
    width_mm: float
    """Width on the screen; pixels are square."""
    quantity: MapQuantity = "mu"
    """Friction coefficients, or relative changes from the friction without voltage."""
    corner_mm: tuple[float, float] = (0.0, 0.0)
    """Place of its upper left corner on the screen."""

    def __post_init__(self) -> None:
        checks.positive("width_mm", self.width_mm)
        checks.choice("quantity", self.quantity, get_args(MapQuantity))
        if self.values.ndim != 2 or not self.values.size or not np.isfinite(self.values).all():
            raise InputError(
                f"values: expected finite values in rows and columns, got {self.values.shape}"
            )

    @property
    def step(self) -> float:
        """Step of the 16 bits; rounding loses half of it at most."""
        return float(np.ptp(self.values)) / _WHITE

    def save(self, path: str | Path) -> None:
        """Write a PNG, and a JSON sidecar of the same name.

        Black and white are the lowest and highest value; nothing but rounding to 16 bits is lost.
        """
        with from_extra("stimuli"):
            from PIL import Image

        path = Path(path)
        low, high = float(self.values.min()), float(self.values.max())
        span = high - low
        level = (self.values - low) / span if span else np.zeros_like(self.values)
        file = io.BytesIO()
        Image.fromarray(np.rint(level * _WHITE).astype(np.uint16)).save(file, "png")
        picture = file.getvalue()
        table = {
            "what": "friction map",
            "quantity": self.quantity,
            "value": "black_is + grey / 65535 * (white_is - black_is)",
            "black_is": low,
            "white_is": high,
            "width_mm": self.width_mm,
            "corner_mm": self.corner_mm,
            "orientation": "x to the right, y downwards",
            "lost": f"rounding to 16 bits: at most {self.step / 2:.3g} in {self.quantity}",
            "sha256": hashlib.sha256(picture).hexdigest(),
        }
        sidecar = path.with_suffix(".json").name
        write_folder(path.parent, {path.name: picture, sidecar: json_text(table)})

    @classmethod
    def load(cls, path: str | Path) -> FrictionMap:
        """Read a PNG with its sidecar.

        Raises `FileFormatError` if either is missing or of another form, or the sidecar is that of
        another picture; `InputError` if the picture has more pixels than a texture may have: see
        `check_picture`.
        """
        with from_extra("stimuli"):
            from PIL import Image

            from haptix.feel.materials.decoded import MOST_KEPT
            from haptix.feel.materials.pictures import check_picture

        path = Path(path)
        beside = path.with_suffix(".json")
        table = read_json(beside)
        with reading(beside, "the sidecar of a friction map"):
            low, high = float(table["black_is"]), float(table["white_is"])
            width, quantity = float(table["width_mm"]), table["quantity"]
            x_mm, y_mm = map(float, table.get("corner_mm", (0.0, 0.0)))
        data = read_bytes(path, LARGEST_PICTURE_BYTES)
        check_picture(f"image: {path}", io.BytesIO(data), most_pixels=MOST_KEPT)
        with reading(path, "a PNG"), Image.open(io.BytesIO(data), formats=["PNG"]) as picture:
            grey = np.asarray(picture)
        if grey.dtype != np.uint16 or grey.ndim != 2:
            raise FileFormatError(f"{path}: expected 16-bit grey, got {grey.dtype} {grey.shape}")
        if table.get("sha256") not in (None, hashlib.sha256(data).hexdigest()):
            raise FileFormatError(f"{path}: is not the picture that its sidecar was written for")
        return cls(low + grey / _WHITE * (high - low), width, quantity, (x_mm, y_mm))


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
        Losses: ``lost`` in words, ``rms`` and ``largest`` of the error of the corners.
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
            "volts, force, carrier, absolute friction and places; the curve between corners "
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
    t_s, share, lost = ahap_intensity(Path(path))
    return Points(tuple(t_s.tolist()), tuple((low + (high - low) * share).tolist())), lost


UNIT_EXPONENT = -6
"""Micrometres, of lines up to `_MOST_UNITS` of them; longer ones have a coarser unit."""

_MOST_UNITS = 65_535  # of a keyframe in the binary form, which has 16 bits for its position


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
        Text and date for the file's head; the date, or time, is in ISO 8601, by default now.

    Returns
    -------
    dict
        Losses: in words, and ``largest_shift_mm`` of a corner.
    """
    places, values = increasing("x_mm", x_mm, 2).tolist(), row("mu", mu, 2).tolist()
    if len(places) != len(values):
        raise InputError(f"mu: expected one value for each of the {len(places)} corners")
    if places[0] < 0 or min(values) < 0 or max(values) > 1:
        raise InputError(
            "x_mm and mu: expected places of 0 mm or more and friction of 0 to 1, which is what "
            "the format holds"
        )
    exponent = UNIT_EXPONENT
    while round((places[-1] - places[0]) * 10.0 ** -(exponent + 3)) > _MOST_UNITS:
        exponent += 1
    unit_mm = 10.0 ** (exponent + 3)
    try:
        written = datetime.now(UTC) if date is None else datetime.fromisoformat(date)
    except ValueError:
        raise InputError(f"date: expected one of ISO 8601, got {date!r:.40}") from None
    if written.tzinfo is None:
        written = written.replace(tzinfo=UTC)
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
        "unit_exponent": exponent, "perception_unit_exponent": 0, "reference_devices": [],
        "effect_library": [], "channels": [channel],
    }  # fmt: skip
    table = {
        "version": "2025",  # year of the standard
        "profile": "Main", "level": 2,
        "date": written.isoformat(timespec="seconds"),  # the schema wants a date-time
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

    The file does not contain the finger's motion, which `speed` gives; a number is in mm/s. Raises
    `FileFormatError` if it is no HJIF, or holds no curve of friction.
    """
    x_mm, mu, lost = hjif_profile(Path(path))
    return relief(tuple(x_mm), tuple(mu), speed), lost
