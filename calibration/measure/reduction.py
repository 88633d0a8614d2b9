"""Reduction of raw forces to mu(F_N, V0, f): zero and drift, full slip, ripple by lock-in."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from math import hypot, log, nan, sqrt
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import TypeAdapter, ValidationError

from calibration.measure.recording import StrokeRecording
from calibration.measure.recording_checks import (
    Zero,
    check_recording,
    drive_amplitude,
    drive_frequency,
    idle_parts,
)
from calibration.measure.segmentation import Segment, full_slip, sliding_speed
from haptix.base.checks import first_error
from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import csv_text, parse_json, read_csv, write_whole
from haptix.base.report import Heading

_BLOCKS = 8  # of a segment: their scatter is the error of its mean
_HIGHEST_SHARE = 0.4  # of the sampling rate, up to which a ripple is looked for
_TOUCHING = 0.4  # of the usual normal force
_LEAST_PERIODS = 8.0  # of the ripple in a segment
_NEIGHBOURS = np.array([-9, -8, -7, -6, -5, 5, 6, 7, 8, 9])  # bins: where there is noise alone
_GAIN_ERROR = 0.002  # of the ratio of two force channels, one way
_RIPPLE_GAIN_ERROR = 0.01  # of the sensor's gain at 2f against its gain at rest


@dataclass(frozen=True)
class Point:
    """One reduced stroke."""

    number: Annotated[int, Heading("stroke")]
    """Number of the stroke."""
    normal_force_n: Annotated[float, Heading("F_N [N]", ".3g")]
    voltage_v: Annotated[float, Heading("V0 [V]", ".3g")]
    frequency_hz: Annotated[float, Heading("f [Hz]", "g")]
    speed_mm_per_s: float
    """As measured, but for the frequency, which is the played one."""
    mu: Annotated[float, Heading("mu", ".3g")]
    mu_sd: Annotated[float, Heading("sd of mu", ".2g")]
    """Mean friction coefficient of the full slip and its standard error."""
    ripple: Annotated[float, Heading("ripple", ".3g")]
    ripple_sd: Annotated[float, Heading("sd of ripple", ".2g")]
    """Amplitude at 2f over the mean friction, without noise; NaN where it cannot be seen."""
    crosstalk: float = nan
    """Half the difference of both directions, over the normal force: a tilted sensor adds it to
    mu in one direction; NaN for one-way strokes."""
    creep: float = nan
    """Relative change of mu for each e-fold of the time in contact; NaN where it was not found."""
    contact_s: float = nan
    """Time in contact [s] at the end of the last slide."""
    rise: float = nan
    rise_sd: float = nan
    """Change of ln mu from the first slides of a long contact to its last ones, and its error; NaN
    of other strokes. Everything else is of the first slides."""
    held_out: Annotated[bool, Heading("kept out")] = False
    """Whether it is kept for verification."""
    outlier: str = ""
    """Why it is not used; empty where it is used."""
    notes: tuple[str, ...] = ()
    """Faults that the reduction has corrected."""

    @property
    def remarks(self) -> Annotated[str, Heading("remarks")]:
        """Why it is not used, and its corrections."""
        return "; ".join(filter(None, (self.outlier, *self.notes)))


@dataclass(frozen=True)
class Reduced:
    """All strokes of a session, reduced; in the order of their numbers."""

    points: tuple[Point, ...]

    @property
    def used(self) -> tuple[Point, ...]:
        """Strokes for the fit: no outliers, none held out."""
        return tuple(p for p in self.points if not p.outlier and not p.held_out)

    @property
    def held_out(self) -> tuple[Point, ...]:
        """Strokes for the verification."""
        return tuple(p for p in self.points if not p.outlier and p.held_out)

    @property
    def outliers(self) -> tuple[Point, ...]:
        """Strokes that are not used, each with its reason."""
        return tuple(p for p in self.points if p.outlier)

    def save(self, path: str | Path) -> None:
        """Write a CSV table that people and `load` read."""
        rows = (
            [json.dumps(value) if name == "notes" else value for name, value in vars(point).items()]
            for point in self.points
        )
        write_whole(path, csv_text(_COLUMNS, rows))

    @classmethod
    def load(cls, path: str | Path) -> Reduced:
        """Read what `save` wrote.

        Raises
        ------
        FileFormatError
            If the file is missing or is not such a table.
        """
        try:
            cells = [dict(row.cells) for row in read_csv(path, _COLUMNS)]
            for cell in cells:
                cell["notes"] = parse_json(cell["notes"])
            return cls(TypeAdapter(tuple[Point, ...]).validate_python(cells))
        except ValidationError as error:
            why = first_error("stroke", error)
        except ValueError as error:
            why = str(error)
        raise FileFormatError(
            f"{path}: expected a table of reduced strokes, got {why}; make it with "
            "`haptix calibrate reduce`"
        )


_COLUMNS = [field.name for field in fields(Point)]


def reduce_session(
    recordings: Iterable[StrokeRecording], idle_s: float = 0.3, crosstalk: float = 0.0
) -> Reduced:
    """Reduce recordings; a stroke that cannot be used has the reason in its `outlier`.

    Parameters
    ----------
    recordings : iterable of StrokeRecording
    idle_s : float
        Time [s] at start and end of each in which nothing touches.
    crosstalk : float
        Share of the normal force that the sensor's tangential axis shows, by its certificate;
        subtracted from strokes of one direction, since there and back it cancels.
    """
    points = [reduce_stroke(recording, idle_s, crosstalk) for recording in recordings]
    if not points:
        raise InputError("expected recordings of one stroke or more, got none; measure first")
    return Reduced(tuple(sorted(points, key=lambda point: point.number)))


def reduce_stroke(recording: StrokeRecording, idle_s: float = 0.3, crosstalk: float = 0.0) -> Point:
    """Reduce one recording; if it cannot be used, the point's `outlier` has the reason."""
    stroke = recording.stroke
    findings = check_recording(recording, idle_s, tolerance=0.5)
    fatal = [str(finding) for finding in findings if finding.is_fatal]
    blank = Point(
        stroke.number,
        stroke.normal_force_n,
        stroke.voltage_v,
        stroke.frequency_hz,
        stroke.speed_mm_per_s,
        *(nan,) * 4,
        held_out=stroke.held_out,
        outlier="; ".join(fatal),
        notes=tuple(str(finding) for finding in findings if not finding.is_fatal),
    )
    if fatal:
        return blank
    recording = without_drift(recording, idle_s)
    normal = recording.normal_force_n
    segments = full_slip(recording.t_s, recording.x_mm, normal)
    if not segments:
        return replace(blank, outlier="no sliding: no part of the stroke slides in full")
    creep, contact_s = _creep(recording, segments)
    rise = rise_sd = nan
    if stroke.contact_s and len(segments) >= 4:
        ends = segments[:2], segments[-2:]
        (first, first_sd), (last, last_sd) = (_both_ways(recording, few) for few in ends)
        if min(first, last) > 0:
            rise, rise_sd = log(last / first), hypot(first_sd / first, last_sd / last)
        segments = segments[:2]
    speed = np.abs(sliding_speed(recording.t_s, recording.x_mm))
    rows = []  # direction, mu, its error, force and speed of each direction
    for direction in sorted({segment.direction for segment in segments}):
        group = [segment for segment in segments if segment.direction == direction]
        ratio, sd = np.array([_ratio(recording, segment) for segment in group]).T
        weights = np.array([segment.stop - segment.start for segment in group], dtype=float)
        weights /= weights.sum()
        inside = np.concatenate([np.arange(segment.start, segment.stop) for segment in group])
        force, moved = normal[inside].mean(), speed[inside].mean()
        rows.append((direction, weights @ ratio, np.sqrt(weights**2 @ sd**2), force, moved))
    directions, ratios, errors, forces, speeds = np.array(rows, dtype=float).T
    # Each direction counts the same, so that cross-talk and a lateral offset cancel.
    mu = float((directions * ratios).mean())
    is_one_way = len(rows) == 1
    if is_one_way:
        mu -= crosstalk * float(directions[0])
    if mu <= 0:
        return replace(blank, outlier=f"wrong sign: mu is {mu:.3g} in full slip")
    by_its_clock = {"frequency_hz": drive_frequency(recording, segments)}
    timed = replace(recording, stroke=stroke.model_copy(update=by_its_clock))
    ripple, ripple_sd = _ripple(timed, segments, _hum(timed, idle_s))
    return replace(
        blank,
        normal_force_n=float(forces.mean()),
        voltage_v=drive_amplitude(recording, segments) if stroke.voltage_v else 0.0,
        speed_mm_per_s=float(speeds.mean()),
        mu=mu,
        mu_sd=hypot(float(np.linalg.norm(errors)) / len(errors), _GAIN_ERROR * mu),
        ripple=ripple,
        ripple_sd=ripple_sd,
        crosstalk=nan if is_one_way else float(ratios.mean()),
        creep=creep / mu,
        contact_s=contact_s,
        rise=rise,
        rise_sd=rise_sd,
    )


def without_drift(recording: StrokeRecording, idle_s: float) -> StrokeRecording:
    """Subtract from both forces the line or the cubic through their idle parts.

    If the finger is still on the screen at the end, subtract only the zero before the touch.
    """
    before, after = idle_parts(recording, idle_s)
    t, normal = recording.t_s, recording.normal_force_n
    rise_n = abs(normal[after].mean() - normal[before].mean())
    has_lifted = rise_n <= 0.3 * recording.stroke.normal_force_n
    flat = {}
    for name in ("normal_force_n", "tangential_force_n"):
        values = getattr(recording, name)
        zero = Zero.of(recording, name, idle_s).at(t) if has_lifted else values[before].mean()
        flat[name] = values - zero
    return replace(recording, **flat)


def _ratio(recording: StrokeRecording, segment: Segment) -> tuple[float, float]:
    """Mean tangential over mean normal force, over whole drive periods, and its error."""
    t = recording.t_s[segment.samples]
    period = 1 / recording.stroke.frequency_hz
    periods = int((t[-1] - t[0]) / period)
    last = int(np.searchsorted(t, t[0] + periods * period)) if periods else len(t)
    shear = recording.tangential_force_n[segment.samples][:last]
    press = recording.normal_force_n[segment.samples][:last]
    ratio = float(shear.mean() / press.mean())
    misfit = shear - ratio * press
    # Blocks of whole periods too, or the ripple itself would look like scatter.
    each = max(periods // _BLOCKS, 1) * period
    count = max(min(_BLOCKS, periods), 2)
    ends = np.searchsorted(t[:last], t[0] + each * np.arange(count + 1))
    blocks = [misfit[a:b].mean() for a, b in pairwise(ends.tolist()) if b > a]
    spread = float(np.std(blocks, ddof=1)) if len(blocks) > 1 else 0.0
    return ratio, spread / sqrt(max(len(blocks), 1)) / abs(float(press.mean()))


def _both_ways(recording: StrokeRecording, segments: list[Segment]) -> tuple[float, float]:
    """Mean friction of slides in both directions, in which cross-talk cancels, and its error."""
    ratio, sd = np.array([_ratio(recording, segment) for segment in segments]).T
    directions = [segment.direction for segment in segments]
    return float((directions * ratio).mean()), float(np.linalg.norm(sd)) / len(segments)


def _creep(recording: StrokeRecording, segments: list[Segment]) -> tuple[float, float]:
    """Slope of the friction over ln(time in contact), and that time [s] at the end.

    Cross-talk is the same at all times.
    """
    normal = recording.normal_force_n
    touching = normal > _TOUCHING * np.median(normal[segments[0].samples])
    begun = float(recording.t_s[int(touching.argmax())])
    rows = []
    for segment in segments:
        parts = np.array_split(np.arange(segment.start, segment.stop), _BLOCKS)
        for part in (part for part in parts if len(part)):
            ratio = recording.tangential_force_n[part].mean() / normal[part].mean()
            lasted = float(recording.t_s[part].mean()) - begun
            if lasted > 0:
                way = float(segment.direction)
                rows.append((ratio, way, way * np.log(lasted), 1.0))
    contact_s = float(recording.t_s[segments[-1].stop - 1]) - begun
    if len(rows) < _BLOCKS:
        return nan, contact_s
    table = np.array(rows)
    # One way only: cross-talk and friction are one number.
    columns = table[:, 1:] if len(set(table[:, 1])) > 1 else table[:, 1:3]
    return float(np.linalg.lstsq(columns, table[:, 0], rcond=None)[0][1]), contact_s


def _hum(recording: StrokeRecording, idle_s: float) -> float:
    """Amplitude [N] of the untouched tangential force at 2f: harmonics of the mains lie there."""
    amplitudes = []
    for part in idle_parts(recording, idle_s):
        t, force = recording.t_s[part], recording.tangential_force_n[part]
        if len(t) > 8:
            turn = np.exp(-4j * np.pi * recording.stroke.frequency_hz * (t - t[0]))
            window = np.hanning(len(t))
            amplitudes.append(2 * abs(turn @ ((force - force.mean()) * window)) / window.sum())
    return max(amplitudes, default=0.0)


def _ripple(
    recording: StrokeRecording, segments: list[Segment], hum_n: float
) -> tuple[float, float]:
    """Amplitude of the friction at 2f over its mean, and its error: a lock-in with a Hann window.

    The noise is that of frequencies beside 2f, in the same window, and the hum at 2f itself, whose
    phase to the ripple is any.
    """
    frequency = 2 * recording.stroke.frequency_hz
    if recording.stroke.voltage_v == 0 or frequency > _HIGHEST_SHARE * recording.sample_rate_hz:
        return nan, nan
    rows = []  # squared amplitude, squared noise, mean and length of each segment
    for segment in segments:
        t = recording.t_s[segment.samples]
        shear = segment.direction * recording.tangential_force_n[segment.samples]
        lasts = float(t[-1] - t[0])
        if lasts * frequency < _LEAST_PERIODS:
            continue
        share = (t - t[0]) / lasts
        window = 1 - np.cos(2 * np.pi * share)
        line = np.polynomial.polynomial.polyfit(share - 0.5, shear, 1)
        alternating = (shear - line[0] - line[1] * (share - 0.5)) * window
        at = np.array([0, *_NEIGHBOURS]) / lasts + frequency
        turn = np.exp(-2j * np.pi * at[at > 0, None] * (t - t[0]))
        power = (2 * np.abs(turn @ alternating) / window.sum()) ** 2
        rows.append((power[0], power[1:].mean(), shear.mean(), lasts))
    if not rows:
        return nan, nan
    powers, noises, means, lengths = np.array(rows).T
    if means.min() <= 0:
        return nan, nan
    power, noise, mean = (
        float(np.average(values, weights=lengths)) for values in (powers, noises, means)
    )
    size = sqrt(max(power - noise, 0.0))
    # One quadrature of the noise moves the amplitude; the segments average.
    sd = hypot(sqrt(noise / 2 / len(rows)), hum_n / sqrt(2 * len(rows)))
    return size / mean, hypot(sd / mean, _RIPPLE_GAIN_ERROR * size / mean, 1e-4)
