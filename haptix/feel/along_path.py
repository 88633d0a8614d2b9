"""Spatial signals, as a finger meets them on its path."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from functools import lru_cache
from inspect import signature
from math import ceil, cos, inf, log2, pi, radians
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BaseModel, Field, PlainSerializer, PlainValidator, model_validator

from haptix.base.checks import choice, increasing, number, plain, row
from haptix.base.errors import InputError
from haptix.base.files import read_csv
from haptix.base.kinds import Kinds, asset_of, by_content, call
from haptix.feel.materials import (
    AnyMaterial,
    FrictionField,
    Grating,
    Noise,
    RecordedProfile,
    Spectral,
    TargetKind,
)
from haptix.feel.motion import VELOCITY_OVER_S, Depends, History, Motion, Report
from haptix.feel.motion.block import Reactions
from haptix.feel.signals.signal import Array, Described, Length, Number, Positive, Row, Signal

SPEEDS = Kinds(
    "haptix.speeds",
    dict.fromkeys(("path", "steady-speed", "strokes"), "haptix.feel.along_path"),
    {"recorded-path": "haptix.feel.along_path:recorded_path"},
)
"""Every kind of speed profile by its name in recipes and sidecars; a subclass enters itself."""


class SpeedProfile(Described):
    """Base of the speed profiles: how a finger moves."""

    kinds: ClassVar[Kinds] = SPEEDS

    @abstractmethod
    def position_mm(self, t_s: Array) -> Array:
        """Place along the finger's line [mm] at times [s]."""

    def velocity_mm_s(self, t_s: Array) -> Array:
        """Mean velocity [mm/s] over `VELOCITY_OVER_S` around times [s]."""
        half = VELOCITY_OVER_S / 2
        ahead, behind = (self.position_mm(t_s + by) for by in (half, -half))
        return np.asarray((ahead - behind) / VELOCITY_OVER_S)


class SteadySpeed(SpeedProfile):
    """A constant speed.

    Parameters
    ----------
    speed_mm_per_s : float

    Examples
    --------
    >>> SteadySpeed(50.0).position_mm(2.0)
    100.0
    """

    speed_mm_per_s: Positive
    kind: Literal["steady-speed"] = "steady-speed"

    def position_mm(self, t_s: Array) -> Array:
        """Place [mm]."""
        return t_s * self.speed_mm_per_s


class Strokes(SpeedProfile):
    """Strokes to and fro over `stroke_mm`, each of `stroke_s`, with the speed of a half sine.

    Parameters
    ----------
    stroke_mm : float
        Length of a stroke [mm].
    stroke_s : float
        Time of a stroke [s].

    Examples
    --------
    >>> there = Strokes(stroke_mm=60.0, stroke_s=1.0).position_mm(np.array([0.0, 1.0, 2.0]))
    >>> there.round(6).tolist()
    [0.0, 60.0, 0.0]
    """

    stroke_mm: Positive
    stroke_s: Positive
    kind: Literal["strokes"] = "strokes"

    def position_mm(self, t_s: Array) -> Array:
        """Place [mm]."""
        return np.asarray(self.stroke_mm * (0.5 - 0.5 * np.cos(np.pi * t_s / self.stroke_s)))


class Path(SpeedProfile):
    """Straight lines between recorded places; the finger stays at the last.

    Parameters
    ----------
    t_s : sequence of float
        Times [s], increasing.
    x_mm : sequence of float
        Places at them [mm].

    Examples
    --------
    >>> Path(t_s=(0.0, 1.0), x_mm=(0.0, 50.0)).position_mm(np.array([0.5, 3.0])).tolist()
    [25.0, 50.0]
    """

    t_s: Row
    x_mm: Row
    kind: Literal["path"] = "path"

    @model_validator(mode="after")
    def _is_a_path(self) -> Self:
        self._check_corners("t_s", "x_mm")
        return self

    def position_mm(self, t_s: Array) -> Array:
        """Place [mm]."""
        return np.asarray(np.interp(t_s, self.t_s, self.x_mm))


def recorded_path(file: str, start_s: float = 0.0) -> Path:
    """Read a finger's own path: a CSV file with columns t_s and x_mm, from a time on."""
    rows = [
        (row.number("t_s") - start_s, row.number("x_mm"))
        for row in read_csv(asset_of(file).path, ("t_s", "x_mm"))
    ]
    kept = [(t_s, x_mm) for t_s, x_mm in rows if t_s >= 0]
    if len(kept) < 2:
        raise InputError(f"{file}: expected two places or more from {start_s:g} s on")
    t_s, x_mm = zip(*kept, strict=True)
    return Path(t_s, x_mm)


def speed_from(table: Any) -> SpeedProfile:
    """Read a profile from a table as `SpeedProfile.describe` writes it; a number is a speed.

    Raises `InputError` if the table is not a speed profile.
    """
    if isinstance(table, SpeedProfile):
        return table
    if table is None:
        raise InputError(
            "expected the finger's speed, which makes a signal of what lies in space; give mm/s or "
            "a speed profile"
        )
    if isinstance(table, Mapping):
        profile: SpeedProfile = SPEEDS.read("speed", table)
        return profile
    number = plain(table)
    return SteadySpeed(table if number is None else number)


AnySpeed = Annotated[
    SpeedProfile, PlainValidator(speed_from), PlainSerializer(lambda profile: profile.describe())
]
"""A field that holds how a finger moves: a profile, its table, or a number [mm/s]."""


def _grating_of(fields: dict[str, Any]) -> Grating:
    """Return a grating whose numbers may be plain, in a stimulus's quantity; no material's are."""
    if fields.get("target") != "plain":
        return Grating(**fields)
    ends = {name: number(name, fields.pop(name, at)) for name, at in (("low", 0.0), ("high", 1.0))}
    plain_ends = {"target": fields.pop("target"), **ends}
    return Grating(**fields).model_copy(update=plain_ends)


def _texture_of(value: Any) -> FrictionField:
    if isinstance(value, FrictionField):
        return value
    fields = dict(value) if isinstance(value, Mapping) else {}
    kind = fields.pop("kind", None)
    if kind == "grating-texture":
        return _grating_of(fields)
    if kind == "profile-texture":
        rows = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in fields.items()
        }
        return call(kind, RecordedProfile, rows)
    raise InputError(f"expected a texture, or a table of one, got {value!r:.80}")


def _texture_table(texture: FrictionField) -> dict[str, Any]:
    if type(texture) is Grating:
        return {**texture.model_dump(), "kind": "grating-texture"}
    if type(texture) is RecordedProfile:
        names = signature(RecordedProfile).parameters
        return {"kind": "profile-texture"} | {name: getattr(texture, name) for name in names}
    raise InputError(
        f"field: a {type(texture).__name__} cannot be written to a sidecar; expected a "
        "Grating or a RecordedProfile"
    )


def _periods(felt: Any, turn_deg: float = 0.0, scale: float = 1.0) -> Iterator[tuple[str, float]]:
    """Yield fields of periodic materials within a material, and their periods along x [mm]."""
    if isinstance(felt, Grating | Noise | Spectral):
        is_of_one_direction = getattr(felt, "grain", "ribbed") == "ribbed"
        angle = radians(felt.orientation_deg + turn_deg) if is_of_one_direction else 0.0
        scale /= max(abs(cos(angle)), 1e-9)
        if isinstance(felt, Grating):
            yield "period_mm", scale * felt.period_mm
        elif isinstance(felt, Spectral):
            yield from (("waves", scale * period_mm) for period_mm, _ in felt.waves)
        elif felt.spectrum is None:
            yield "longest_mm", scale * felt.longest_mm
    elif isinstance(felt, tuple):
        for part in felt:
            yield from _periods(part, turn_deg, scale)
    elif isinstance(felt, BaseModel):  # of a layout, a region may be turned and scaled
        turn_deg += getattr(felt, "rotation_deg", None) or 0.0
        scale *= getattr(felt, "scale", None) or 1.0
        for name in type(felt).model_fields:
            yield from _periods(getattr(felt, name), turn_deg, scale)


def _check_rate(felt: Any, velocity_mm_s: Array, sample_rate_hz: float) -> None:
    """Raise `InputError` if a finger meets a period more often than the sample rate carries.

    Only fundamentals count. Harmonics of sharp shapes are sampled as they are.
    """
    speed, half_hz = float(np.abs(velocity_mm_s).max(initial=0.0)), sample_rate_hz / 2
    for name, period_mm in _periods(felt):
        if speed / period_mm >= half_hz:
            raise InputError(
                f"{name}: a period of {period_mm:.4g} mm at {speed:.4g} mm/s is "
                f"{speed / period_mm:.6g} Hz, expected less than {half_hz:g} Hz, half of the "
                f"{sample_rate_hz:g} samples per second; lengthen the period above "
                f"{speed / half_hz:.3g} mm, or slow the finger down"
            )


class AlongPath(Signal):
    """Values of a texture where the finger is: on the line y = 0, with all detail.

    The numbers of the texture are in the stimulus's quantity; its target is not read. Periods that
    the finger meets at half of the sample rate or more are refused; harmonics are not filtered.

    Parameters
    ----------
    field : FrictionField
    speed : SpeedProfile or float, optional
        How the finger moves; a number is a steady speed [mm/s].
    length_s : float
    """

    field: Annotated[FrictionField, PlainValidator(_texture_of), PlainSerializer(_texture_table)]
    speed: AnySpeed = Field(None, validate_default=True)
    length_s: Length = inf
    kind: Literal["along-path"] = "along-path"

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        t = np.arange(first, first + count) / sample_rate_hz
        _check_rate(self.field, self.speed.velocity_mm_s(t), sample_rate_hz)
        return self.field.friction(self.speed.position_mm(t), np.zeros(count))


def grating(
    amplitude: float,
    period_mm: float,
    speed: SpeedProfile | float | None = None,
    shape: str = "sine",
    phase_rad: float = 0.0,
    offset: float = 0.0,
    length_s: float = inf,
) -> AlongPath:
    """Return a grating ``offset + amplitude * sin`` or square as a finger of this speed meets it.

    Parameters
    ----------
    amplitude, offset : float
        Amplitude and mean, in the stimulus's quantity.
    period_mm : float
        Spatial period [mm].
    speed : SpeedProfile or float
        How the finger moves; a number is a steady speed [mm/s].
    shape : str
        "sine" or "square".
    phase_rad : float
        Phase at the finger's start [rad].
    length_s : float
        Length [s]; endless if not given.

    Examples
    --------
    >>> ribs = grating(0.1, period_mm=2.0, speed=50.0, offset=0.4, length_s=1.0)
    >>> ribs.length_s
    1.0
    """
    for name, value in (("amplitude", amplitude), ("phase_rad", phase_rad), ("offset", offset)):
        number(name, value)
    fields = {
        "period_mm": period_mm,
        "wave": choice("shape", shape, ("sine", "square")),
        "phase": phase_rad / (2 * pi),
        "target": "plain",
        "low": offset - amplitude,
        "high": offset + amplitude,
    }
    return AlongPath(_grating_of(fields), speed_from(speed), length_s)


def relief(
    x_mm: tuple[float, ...],
    values_at: tuple[float, ...],
    speed: SpeedProfile | float | None = None,
    length_s: float = inf,
) -> AlongPath:
    """Return straight lines between corners on the screen, as a finger of this speed meets them.

    Parameters
    ----------
    x_mm : sequence of float
        Places of the corners [mm], increasing.
    values_at : sequence of float
        Values at them, in the stimulus's quantity.
    speed : SpeedProfile or float
        How the finger moves; a number is a steady speed [mm/s].
    length_s : float
        Length [s]; endless if not given.

    Examples
    --------
    >>> bump = relief((0.0, 5.0, 10.0), (0.3, 0.6, 0.3), speed=50.0, length_s=0.2)
    >>> bump.length_s
    0.2
    """
    places, values = increasing("x_mm", x_mm, 2), row("values_at", values_at, 2)
    # The grid's step matters to footprints only, and a stimulus has none.
    step_mm = float(np.ptp(places)) / 1000
    profile = RecordedProfile(
        tuple(places.tolist()), tuple(values.tolist()), "plain", beyond="hold", step_mm=step_mm
    )
    return AlongPath(profile, speed_from(speed), length_s)


_REPORT_S = 1e-3  # between two reports of the finger to a material


class MaterialSignal(Signal):
    """A material's target under the finger, along x at a height `y_mm`, with all detail.

    Time counts from the first sample, at which the finger comes down. The force is constant, so
    that no button is pressed. A detent counts from the first millisecond at which it has been
    crossed, so that no sample depends on later ones. Periods are refused as in `AlongPath`, by the
    finger's speed over the screen.

    Parameters
    ----------
    of : Material
        Or its table, or the path of its file.
    speed : SpeedProfile or float
        How the finger moves; a number is a steady speed [mm/s].
    y_mm : float
        Where.
    normal_force_n : float
        Normal force [N]; in a stimulus, that of the stimulus.
    length_s : float
        Length.
    """

    of: AnyMaterial
    speed: AnySpeed = Field(None, validate_default=True)
    y_mm: Number = 0.0
    normal_force_n: Positive = 0.5
    length_s: Length = inf
    kind: Literal["material"] = "material"

    @property
    def target(self) -> TargetKind:
        """Quantity of the values."""
        return self.of.evaluator.target

    def describe(self) -> dict[str, Any]:
        """Everything that determines the values; the material's files by their content."""
        with by_content():
            return super().describe()

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        evaluator = self.of.evaluator
        t = np.arange(first, first + count) / sample_rate_hz
        velocity = self.speed.velocity_mm_s(t)
        _check_rate(self.of, velocity, sample_rate_hz)
        history: History = ()
        if Depends.FACTS in evaluator.depends_on:
            # Powers of two, so that of blocks one after the other each finds few facts anew.
            history = _facts(self, 2 ** ceil(log2(t[-1] + 2 * _REPORT_S)))
        motion = Motion.of(
            self.speed.position_mm(t), self.y_mm, t, velocity, 0.0,
            self.normal_force_n, history=history,
        )  # fmt: skip
        return evaluator.wanted(motion)


@lru_cache(maxsize=8)
def _facts(signal: MaterialSignal, until_s: float) -> History:
    """Facts of the finger on its path until a time."""
    reactions, react = Reactions(kept=None), signal.of.evaluator.react
    t = np.arange(0.0, until_s, _REPORT_S)
    for t_s, x_mm in zip(t.tolist(), signal.speed.position_mm(t).tolist(), strict=True):
        reactions.report(Report(t_s, x_mm, signal.y_mm, signal.normal_force_n), react, t_s)
    return reactions.history
