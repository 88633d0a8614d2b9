"""What can be wrong with a recording: recognised and named, before anything is made of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calibration.parameters import Array
from calibration.recording import SIGNALS, StrokeRecording
from calibration.segmentation import Segment, full_slip, sliding_speed

_IDLE_USED = 0.8  # of the untouched time, away from its ends
_HIGHEST_MU = 20.0  # friction of a finger under voltage stays well below
_LOST_SHARE = 0.01
_ZERO_SHARE = 0.2  # of the wanted force: beyond, the sensor was not zeroed
_PARTS = 8  # of the untouched time
_EARLY_SHARE = 0.3  # of the wanted force, while nothing should touch
_DRIVE_TOLERANCE = 0.05
_ENOUGH_OF_THE_WAY = 0.9

_FORCE_UNITS = {"mN": 1e3, "gf": 101.97, "kgf": 0.10197, "lbf": 0.22481, "uN": 1e6}
_LENGTH_UNITS = {"m": 1e-3, "cm": 0.1, "um": 1e3}


@dataclass(frozen=True)
class Complaint:
    """One thing that is wrong.

    Parameters
    ----------
    kind : str
        Such as "clipped force".
    message : str
        What was expected, what was found and what to do.
    is_fatal : bool
        False where the reduction can make up for it.
    """

    kind: str
    message: str
    is_fatal: bool = True

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}"


def idle_parts(recording: StrokeRecording, idle_s: float) -> tuple[slice, slice]:
    """Samples before the touch and after it, while the finger is off."""
    t = recording.t_s
    used = _IDLE_USED * idle_s
    first = int(np.searchsorted(t, t[0] + used))
    last = int(np.searchsorted(t, t[-1] - used))
    return slice(0, max(first, 1)), slice(min(last, len(t) - 1), len(t))


def complaints(
    recording: StrokeRecording, idle_s: float, tolerance: float = 0.15
) -> list[Complaint]:
    """Name everything that is wrong with a recording; empty where it is good.

    Parameters
    ----------
    recording : StrokeRecording
        As it came from the instruments.
    idle_s : float
        Untouched time at its start and end [s].
    tolerance : float
        Share by which force and speed may be off.
    """
    numbers = list(_numbers(recording))
    if numbers:
        return numbers
    found = list(_times(recording))
    if any(one.kind != "dropped samples" for one in found):
        return found
    found += _clipping(recording, idle_s)
    length = list(_sliding(recording))
    if length:
        return found + length
    segments = full_slip(
        recording.t_s,
        recording.x_mm,
        settling_mm=0.1 * recording.stroke.length_mm,
        stopping_mm=0.05 * recording.stroke.length_mm,
    )
    if not segments:
        return [*found, Complaint("no sliding", _slide_more(recording, 0.0))]
    found += _end(recording, segments, idle_s)
    early = list(_touched_early(recording, segments, idle_s))
    if early:  # without a zero nothing can be said of the forces
        return [*found, *early]
    forces = list(_axes(recording, segments, idle_s))
    found += forces
    if not forces:  # in a wrong unit nothing else can be said of them
        found += _zero(recording, idle_s)
        found += _off_target(recording, segments, idle_s, tolerance)
    found += _drive(recording, segments)
    return found


def _numbers(recording: StrokeRecording) -> Iterator[Complaint]:
    for name in SIGNALS:
        bad = int((~np.isfinite(getattr(recording, name))).sum())
        if bad:
            yield Complaint(
                "no numbers", f"{bad} samples of {name} are not finite; check the export"
            )


def _times(recording: StrokeRecording) -> Iterator[Complaint]:
    step = np.diff(recording.t_s)
    usual = float(np.median(step))
    if usual <= 0 or (step <= 0).any():
        yield Complaint(
            "wrong times",
            f"expected times that increase, got a step of {step.min():g} s after sample "
            f"{int(step.argmin())}; export the instrument's own clock",
        )
        return
    planned = recording.stroke.sliding_s
    lasted = float(recording.t_s[-1] - recording.t_s[0])
    if lasted > 300 * planned:
        yield Complaint(
            "wrong units",
            f"expected a recording of some {planned + 1:.1f} s, got {lasted:g} s: are the times "
            'in milliseconds? Say unit = "ms" in the column map',
        )
    gaps = step > 1.5 * usual
    lost = float((step[gaps] - usual).sum())
    if gaps.any():
        yield Complaint(
            "dropped samples",
            f"{round(lost / usual)} samples are missing in {int(gaps.sum())} places, the first "
            f"after {recording.t_s[int(gaps.argmax())] - recording.t_s[0]:.3f} s; check the "
            "instrument's buffer",
            is_fatal=lost > _LOST_SHARE * lasted,
        )


def _clipping(recording: StrokeRecording, idle_s: float) -> Iterator[Complaint]:
    before, _ = idle_parts(recording, idle_s)
    for name in ("normal_force_n", "tangential_force_n"):
        values = getattr(recording, name)
        if not np.ptp(values[before]) > 0:
            continue  # free of noise, where a constant says nothing
        for extreme, side in ((values.max(), "upper"), (values.min(), "lower")):
            at_end = int((values == extreme).sum())
            others = values[values != extreme]
            if not len(others):
                continue
            beside = others.max() if side == "upper" else others.min()
            # Noise thins out towards its extremes; a full scale piles up there.
            if at_end >= 20 and at_end > 5 * int((values == beside).sum()):
                yield Complaint(
                    "clipped force",
                    f"{at_end} samples of {name} stand at {extreme:.4g} N, the {side} end of its "
                    "scale; choose a wider range of the sensor or a smaller force",
                )


def _sliding(recording: StrokeRecording) -> Iterator[Complaint]:
    planned = recording.stroke.length_mm
    way = float(np.ptp(recording.x_mm))
    if way >= _ENOUGH_OF_THE_WAY * planned:
        for unit, factor in _LENGTH_UNITS.items():
            if factor > 1 and 0.7 * factor < way / planned < 1.4 * factor:
                yield Complaint(
                    "wrong units",
                    f"expected a stroke of {planned:g} mm, got {way:g}: is x in {unit}? Say so in "
                    "the column map",
                )
        return
    for unit, factor in _LENGTH_UNITS.items():
        if factor < 1 and 0.85 * factor < way / planned < 1.2 * factor and _is_smooth(recording):
            yield Complaint(
                "wrong units",
                f"expected a stroke of {planned:g} mm, got {way:.3g}: is x in {unit}? Say so in "
                "the column map",
            )
            return
    if _still_sliding(recording):
        yield Complaint(
            "stopped half-way",
            f"the recording ends while the finger slides, after {way:.3g} of {planned:g} mm; "
            "repeat the stroke",
        )
        return
    yield Complaint("no sliding", _slide_more(recording, way))


def _slide_more(recording: StrokeRecording, way: float) -> str:
    return (
        f"expected {recording.stroke.length_mm:g} mm, got {way:.3g} mm; slide the whole way, and "
        "check that the position is recorded"
    )


def _is_smooth(recording: StrokeRecording) -> bool:
    """Whether the position moves as a stroke does, rather than trembling in place."""
    distance = float(np.abs(np.diff(recording.x_mm)).sum())
    ways = 1 + recording.stroke.there_and_back
    return distance < 1.5 * ways * float(np.ptp(recording.x_mm))


def _still_sliding(recording: StrokeRecording) -> bool:
    speed = np.abs(sliding_speed(recording.t_s, recording.x_mm))
    return bool(speed[-3:].mean() > 0.5 * recording.stroke.speed_mm_per_s)


def _end(recording: StrokeRecording, segments: list[Segment], idle_s: float) -> Iterator[Complaint]:
    ways = 1 + recording.stroke.there_and_back
    if len({segment.direction for segment in segments}) < ways:
        yield Complaint(
            "stopped half-way",
            "expected the finger to slide there and back, got one direction; repeat the stroke",
        )
        return
    _, after = idle_parts(recording, idle_s)
    force = recording.normal_force_n
    in_slip = np.concatenate([force[s.samples] for s in segments])
    before, _ = idle_parts(recording, idle_s)
    rest = abs(float(force[after].mean()) - float(force[before].mean()))
    if rest > 0.5 * abs(float(in_slip.mean()) - float(force[before].mean())):
        yield Complaint(
            "stopped half-way",
            "the recording ends before the finger has left the screen, so that drift cannot be "
            f"told; record {idle_s:g} s more",
            is_fatal=_still_sliding(recording),
        )


def _level(
    recording: StrokeRecording, values: Array, segments: list[Segment], idle_s: float
) -> float:
    """Mean in the segments above the idle level before."""
    before, _ = idle_parts(recording, idle_s)
    inside = np.concatenate([values[s.samples] for s in segments])
    return float(inside.mean()) - float(np.median(values[before]))


def _axes(
    recording: StrokeRecording, segments: list[Segment], idle_s: float
) -> Iterator[Complaint]:
    wanted = recording.stroke.normal_force_n
    normal = _level(recording, recording.normal_force_n, segments, idle_s)
    one = [s for s in segments if s.direction == segments[0].direction]
    drag = _level(recording, recording.tangential_force_n, one, idle_s) * one[0].direction
    back = [s for s in segments if s.direction != segments[0].direction]
    if back:  # what does not turn with the direction is not friction
        other = -one[0].direction
        drag_back = _level(recording, recording.tangential_force_n, back, idle_s) * other
        normal_one = _level(recording, recording.normal_force_n, one, idle_s)
        normal_back = _level(recording, recording.normal_force_n, back, idle_s)
        turns = abs(normal_one - normal_back) > abs(normal_one + normal_back)
        swapped = turns and abs(drag + drag_back) < abs(drag - drag_back)
        drag = (drag + drag_back) / 2
    else:
        swapped = abs(abs(drag) / wanted - 1) < 0.3 and abs(normal) < 0.7 * wanted
    if swapped:
        yield Complaint(
            "swapped axes",
            f"the normal force reads {normal:.3g} N and the tangential one {drag:.3g} N, where "
            f"{wanted:g} N were to be pressed; swap the two columns",
        )
        return
    if normal < -0.3 * wanted:
        yield Complaint(
            "wrong sign",
            f"expected a normal force of {wanted:g} N, got {normal:.3g} N; give the column "
            "scale = -1",
        )
        return
    for unit, factor in _FORCE_UNITS.items():
        if 0.7 < normal / wanted / factor < 1.4:
            yield Complaint(
                "wrong units",
                f"expected a normal force of {wanted:g} N, got {normal:.3g}: is it in {unit}? Say "
                "so in the column map",
            )
            return
    if normal <= 0.3 * wanted:
        return
    mu = drag / normal
    if mu < 0:
        yield Complaint(
            "wrong sign",
            f"the tangential force pulls the finger along (mu {mu:.3g}); give the column scale = "
            "-1, or turn x around",
        )
    elif mu > _HIGHEST_MU:
        yield Complaint(
            "wrong units",
            f"expected mu below {_HIGHEST_MU:g}, got {mu:.3g}: is the tangential force in mN? Say "
            "so in the column map",
        )


def _touched_early(
    recording: StrokeRecording, segments: list[Segment], idle_s: float
) -> Iterator[Complaint]:
    before, _ = idle_parts(recording, idle_s)
    force = recording.normal_force_n
    if len(force[before]) < _PARTS:
        return
    level = abs(_level(recording, force, segments, idle_s))
    # Means of parts: a touch, not noise.
    spread = float(np.ptp([part.mean() for part in np.array_split(force[before], _PARTS)]))
    if spread > _EARLY_SHARE * max(level, recording.stroke.normal_force_n):
        yield Complaint(
            "never zeroed",
            f"the normal force changes by {spread:.3g} in the first {idle_s:g} s, when nothing "
            "should touch the screen: there is no zero to take off; keep the finger off until the "
            "prompt",
        )


def _zero(recording: StrokeRecording, idle_s: float) -> Iterator[Complaint]:
    before, _ = idle_parts(recording, idle_s)
    wanted = recording.stroke.normal_force_n
    for name in ("normal_force_n", "tangential_force_n"):
        rest = getattr(recording, name)[before]
        level = float(np.median(rest))
        if abs(level) > _ZERO_SHARE * wanted:
            yield Complaint(
                "never zeroed",
                f"{name} reads {level:.3g} N before the touch; it is taken off, but zero the "
                "sensor so that its range is not used up",
                is_fatal=False,
            )


def _off_target(
    recording: StrokeRecording, segments: list[Segment], idle_s: float, tolerance: float
) -> Iterator[Complaint]:
    stroke = recording.stroke
    force = _level(recording, recording.normal_force_n, segments, idle_s)
    off = force / stroke.normal_force_n - 1
    if abs(off) > tolerance:
        yield Complaint(
            "force off",
            f"expected {stroke.normal_force_n:g} N within {tolerance:.0%}, got {force:.3g} N "
            f"({off:+.0%}); press {'less' if off > 0 else 'harder'}",
        )
    speed = np.abs(sliding_speed(recording.t_s, recording.x_mm))
    inside = float(np.concatenate([speed[s.samples] for s in segments]).mean())
    off = inside / stroke.speed_mm_per_s - 1
    if abs(off) > tolerance:
        yield Complaint(
            "speed off",
            f"expected {stroke.speed_mm_per_s:g} mm/s within {tolerance:.0%}, got {inside:.3g} "
            f"mm/s ({off:+.0%}); slide {'slower' if off > 0 else 'faster'}",
        )


def drive_amplitude(recording: StrokeRecording, segments: list[Segment]) -> float:
    """Amplitude [V] at the stroke's frequency, over parts of a recording."""
    found = []
    for segment in segments:
        t, drive = recording.t_s[segment.samples], recording.drive_v[segment.samples]
        turn = 2 * np.pi * recording.stroke.frequency_hz * (t - t[0])
        basis = np.stack([np.cos(turn), np.sin(turn), np.ones_like(turn)], axis=-1)
        weights = np.linalg.lstsq(basis, drive, rcond=None)[0]
        found.append(float(np.hypot(weights[0], weights[1])))
    return float(np.mean(found))


def _drive(recording: StrokeRecording, segments: list[Segment]) -> Iterator[Complaint]:
    stroke = recording.stroke
    if recording.sample_rate_hz < 2.2 * stroke.frequency_hz:
        return  # the monitor cannot show it
    played = drive_amplitude(recording, segments)
    if abs(played - stroke.voltage_v) > max(_DRIVE_TOLERANCE * stroke.voltage_v, 1.0):
        yield Complaint(
            "drive off",
            f"expected an amplitude of {stroke.voltage_v:g} V, got {played:.4g} V on the screen; "
            "check amplifier, cable and the divider's scale",
        )
