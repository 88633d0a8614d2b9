"""Checks of a recording before it is reduced: each fault has a name and a remedy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from calibration.parameters import Array
from calibration.recording import SIGNALS, StrokeRecording
from calibration.segmentation import Segment, full_slip, sliding_speed

_IDLE_USED = 0.8  # of the untouched time, away from the touch
_HIGHEST_MU = 20.0  # friction of a finger under voltage stays well below
_LOST_SHARE = 0.01
_ZERO_SHARE = 0.2  # of the planned force: a larger offset means that the sensor was not zeroed
_PARTS = 8  # of the untouched time
_EARLY_SHARE = 0.3  # of the planned force, while nothing should touch
_DRIVE_TOLERANCE = 0.05
_FULL_LENGTH = 0.9  # of the planned length
_LOWEST_MU = 0.08  # of a finger: below it lbf or kgf were read as N
_DEAD_MU = 0.02  # of a tangential channel that shows no friction
_LOWEST_RATE_HZ = 1000.0  # ripples of the usual 125 Hz, and every start and stop, are seen above it
_LEAST_ALIAS_HZ = 20.0  # a ripple that looks slower than this does not average out in a slide
_HELD_SHARE = 0.4  # of repeated samples: every other one gives 0.5
_RIGID = 0.15  # of the tremor of the normal force: friction under voltage shows a third or more
_FLAT_SKEW = -0.5  # of the tangential force's fast part: a sine has 0, a spike above it

_FORCE_UNITS = {"mN": 1e3, "gf": 101.97, "kgf": 0.10197, "lbf": 0.22481, "uN": 1e6}
_LENGTH_UNITS = {"m": 1e-3, "cm": 0.1, "inch": 1 / 25.4, "um": 1e3}
_FORCES = ("normal_force_n", "tangential_force_n")


@dataclass(frozen=True)
class Finding:
    """One fault of a recording.

    Parameters
    ----------
    kind : str
        Kind of fault, such as "clipped force".
    message : str
        What was expected, what was found and what to do.
    is_fatal : bool
        False where the reduction can correct it.
    """

    kind: str
    message: str
    is_fatal: bool = True

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}"


def check_recording(
    recording: StrokeRecording, idle_s: float, tolerance: float = 0.15
) -> list[Finding]:
    """Return all faults of a recording; an empty list where it is good.

    It is untouched for `idle_s` at its start and end [s]. Force and speed may have a relative error
    of `tolerance`.
    """
    bad = {name: int((~np.isfinite(getattr(recording, name))).sum()) for name in SIGNALS}
    if any(bad.values()):
        return [
            Finding("no numbers", f"{count} samples of {name} are not finite; check the export")
            for name, count in bad.items()
            if count
        ]
    findings = list(_times(recording))
    if any(one.kind != "dropped samples" for one in findings):
        return findings
    findings += _clipping(recording, idle_s)
    if length := list(_sliding(recording)):
        return findings + length
    stroke = recording.stroke
    segments = full_slip(
        recording.t_s,
        recording.x_mm,
        settling_mm=0.1 * stroke.length_mm,
        stopping_mm=0.05 * stroke.length_mm,
    )
    if not segments:
        return [*findings, _too_short(recording, 0.0)]
    checks = _SlidingChecks(recording, segments, idle_s)
    if dead := list(checks.dead()):
        return findings + dead
    findings += checks.end()
    findings += checks.held()
    if early := list(checks.touched_early()):
        return findings + early  # without a zero the forces mean nothing
    forces = list(checks.force_axes())
    findings += forces
    if not forces:  # in a wrong unit no other check of the forces means anything
        findings += checks.zero()
        findings += checks.off_target(tolerance)
        if not any(one.kind == "clipped force" for one in findings):
            findings += checks.flattened()
    if "drive_v" not in recording.assumed:
        findings += checks.drive()
    return findings


def idle_parts(recording: StrokeRecording, idle_s: float) -> tuple[slice, slice]:
    """Samples before the touch and after it, while the finger is off."""
    t = recording.t_s
    used = _IDLE_USED * idle_s
    first = int(np.searchsorted(t, t[0] + used))
    last = int(np.searchsorted(t, t[-1] - used))
    return slice(0, max(first, 1)), slice(min(last, len(t) - 1), len(t))


def drive_amplitude(recording: StrokeRecording, segments: list[Segment]) -> float:
    """Amplitude [V] at the stroke's frequency, over parts of a recording.

    The planned one where the recording is too slow to show it.
    """
    if recording.sample_rate_hz < 2.2 * recording.stroke.frequency_hz:
        return recording.stroke.voltage_v
    frequency_hz = recording.stroke.frequency_hz
    amplitudes = [
        sine_amplitude(recording.t_s[part.samples], recording.drive_v[part.samples], frequency_hz)
        for part in segments
    ]
    return float(np.mean(amplitudes))


def sine_amplitude(t_s: Array, values: Array, frequency_hz: float) -> float:
    """Amplitude of a sine of known frequency, beside a constant; least squares."""
    phase = 2 * np.pi * frequency_hz * (t_s - t_s[0])
    basis = np.stack([np.cos(phase), np.sin(phase), np.ones_like(phase)], axis=-1)
    return float(np.hypot(*np.linalg.lstsq(basis, values, rcond=None)[0][:2]))


def _times(recording: StrokeRecording) -> Iterator[Finding]:
    step = np.diff(recording.t_s)
    usual = float(np.median(step))
    if usual <= 0 or (step <= 0).any():
        yield Finding(
            "wrong times",
            f"expected times that increase, got a step of {step.min():g} s after sample "
            f"{int(step.argmin())}; export the instrument's own clock",
        )
        return
    planned = recording.stroke.sliding_s
    lasted = float(recording.t_s[-1] - recording.t_s[0])
    if lasted > 300 * planned:
        yield _wrong_unit(f"a recording of some {planned + 1:.1f} s", lasted, "ms")
        return
    rate, ripple = 1 / usual, 2 * recording.stroke.frequency_hz
    alias = abs(ripple - round(ripple / rate) * rate)
    if rate < 0.99 * _LOWEST_RATE_HZ:
        yield Finding(
            "slow sampling",
            f"expected {_LOWEST_RATE_HZ:g} samples a second or more, got {rate:.4g}; record faster",
        )
    elif recording.stroke.voltage_v and alias < _LEAST_ALIAS_HZ:
        yield Finding(
            "slow sampling",
            f"at {rate:.6g} samples a second the ripple at {ripple:g} Hz looks like one of "
            f"{alias:.2g} Hz and does not average out; record at another rate",
        )
    gaps = step > 1.5 * usual
    if gaps.any():
        lost = float((step[gaps] - usual).sum())
        yield Finding(
            "dropped samples",
            f"{round(lost / usual)} samples are missing in {int(gaps.sum())} places, the first "
            f"after {recording.t_s[int(gaps.argmax())] - recording.t_s[0]:.3f} s; check the "
            "instrument's buffer",
            is_fatal=lost > _LOST_SHARE * lasted,
        )


def _clipping(recording: StrokeRecording, idle_s: float) -> Iterator[Finding]:
    before, _ = idle_parts(recording, idle_s)
    for name in _FORCES:
        values = getattr(recording, name)
        if not np.ptp(values[before]) > 0:
            continue  # a signal without noise may well be constant
        levels, counts = np.unique(values, return_counts=True)
        for side, extreme, beside in (("upper", -1, -2), ("lower", 0, 1)):
            # Noise has few samples at its extremes; a full scale has many.
            if counts[extreme] >= 20 and counts[extreme] > 5 * counts[beside]:
                yield Finding(
                    "clipped force",
                    f"{counts[extreme]} samples of {name} stand at {levels[extreme]:.4g} N, the "
                    f"{side} end of its scale; choose a wider range of the sensor or a smaller "
                    "force",
                )


def _sliding(recording: StrokeRecording) -> Iterator[Finding]:
    planned = recording.stroke.length_mm
    length = float(np.ptp(recording.x_mm))
    is_long = length >= _FULL_LENGTH * planned
    bounds = (0.9, 1.12) if is_long else (0.85, 1.2)
    # In a stroke the position moves; in place it trembles.
    distance = float(np.abs(np.diff(recording.x_mm)).sum())
    is_smooth = distance < 1.5 * recording.stroke.slides * length
    unit = _unit(length / planned, _LENGTH_UNITS, *bounds)
    if unit and (is_long or is_smooth):
        yield _wrong_unit(f"a stroke of {planned:g} mm", length, unit)
    elif length > 3 * planned:
        yield Finding(
            "wrong units",
            f"expected a stroke of {planned:g} mm, got {length:.4g}: are these counts of an "
            f"encoder? Give the column the millimetres of one count as its scale, some "
            f"{planned / length:.2g}",
        )
    elif is_long:
        return
    elif _still_sliding(recording):
        yield Finding(
            "stopped half-way",
            f"the recording ends while the finger slides, after {length:.3g} of {planned:g} mm; "
            "repeat the stroke",
        )
    else:
        yield _too_short(recording, length)


def _wrong_unit(expected: str, got: float, unit: str) -> Finding:
    return Finding(
        "wrong units",
        f"expected {expected}, got {got:.3g}: is it in {unit}? Say so in the column map",
    )


def _dead(name: str, what: str) -> Finding:
    return Finding("dead channel", f"{name} {what}; check sensor, cable and channel")


def _too_short(recording: StrokeRecording, length_mm: float) -> Finding:
    return Finding(
        "no sliding",
        f"expected {recording.stroke.length_mm:g} mm, got {length_mm:.3g} mm; slide the full "
        "length, and check that the position is recorded",
    )


def _unit(
    ratio: float, units: Mapping[str, float], low: float = 0.7, high: float = 1.4
) -> str | None:
    """Unit in which a value reads `ratio` times as much as in the planned one."""
    return next((unit for unit, factor in units.items() if low < ratio / factor < high), None)


def _still_sliding(recording: StrokeRecording) -> bool:
    speed = np.abs(sliding_speed(recording.t_s, recording.x_mm))
    return bool(speed[-3:].mean() > 0.5 * recording.stroke.speed_mm_per_s)


class _SlidingChecks:
    """Checks of a recording in which the finger slides, in `segments`."""

    def __init__(self, recording: StrokeRecording, segments: list[Segment], idle_s: float) -> None:
        self.recording, self.segments, self.idle_s = recording, segments, idle_s
        self.stroke = recording.stroke
        self.before, self.after = idle_parts(recording, idle_s)

    def level(self, name: str, direction: int | None = None) -> float:
        """Mean of a signal in full slip, above its median before the touch."""
        values = getattr(self.recording, name)
        return self.mean(values, direction) - float(np.median(values[self.before]))

    def drift(self, name: str) -> float:
        """Change of a signal from before the touch to the middle of the stroke."""
        values = getattr(self.recording, name)
        return float(np.median(values[self.after]) - np.median(values[self.before])) / 2

    def mean(self, values: Array, direction: int | None = None) -> float:
        """Mean in full slip, of one direction or of all."""
        chosen = [one for one in self.segments if direction in (None, one.direction)]
        return float(np.concatenate([values[one.samples] for one in chosen]).mean())

    def dead(self) -> Iterator[Finding]:
        for name in _FORCES:
            if not np.ptp(getattr(self.recording, name)) > 0:
                yield _dead(name, "does not change at all")

    def held(self) -> Iterator[Finding]:
        """Values that stand for several samples: the ripple is lower than it was."""
        for name in _FORCES:
            values = getattr(self.recording, name)
            steps = np.abs(np.concatenate([np.diff(values[one.samples]) for one in self.segments]))
            moved = steps[steps > 0]
            # Where the resolution is coarse, neighbours are equal too, but differ by one level.
            if len(moved) and np.median(moved) > 3 * moved.min():
                share = 1 - len(moved) / len(steps)
                if share > _HELD_SHARE:
                    yield Finding(
                        "held samples",
                        f"{share:.0%} of the samples of {name} repeat the one before: it was "
                        f"recorded {1 / (1 - share):.2g} times more slowly than its times say, and "
                        "the ripple is blurred; export the instrument's own rate",
                    )

    def flattened(self) -> Iterator[Finding]:
        """A tangential force that stands still at a level, with the noise of what follows it.

        Friction goes with the normal force, so it shows that force's tremor; and it rises more
        than it falls within a ripple. A saturated channel does neither.
        """
        rate = self.recording.sample_rate_hz
        ripple = 2 * self.stroke.frequency_hz
        block = max(round(rate / ripple), round(0.01 * rate), 1)
        noise = float(self.recording.tangential_force_n[self.before].std())
        for one in self.segments:
            shear = one.direction * self.recording.tangential_force_n[one.samples]
            press = self.recording.normal_force_n[one.samples]
            count = len(shear) // block
            if count < 8:
                continue
            slow_shear, slow_press = (
                values[: count * block].reshape(count, block).mean(-1) for values in (shear, press)
            )
            expected = float(slow_press.std() * slow_shear.mean() / slow_press.mean())
            noise_of_mean = noise / np.sqrt(block)
            left = max(float(slow_shear.var()) - noise_of_mean**2, 0.0)
            is_rigid = expected > 4 * noise_of_mean and left < (_RIGID * expected) ** 2
            fast = shear[: count * block] - np.repeat(slow_shear, block)
            spread = float(fast.std())
            skew = float((fast**3).mean()) / max(spread, 1e-30) ** 3
            # Stick-slip is skewed too, but has no noise alone on one side.
            above = float(np.diff(np.percentile(fast, [50, 99]))[0])
            is_flat = skew < _FLAT_SKEW and spread > 2 * noise and above < 5 * noise
            if is_rigid or is_flat:
                yield Finding(
                    "clipped force",
                    f"tangential_force_n stays near {slow_shear.mean():.3g} N where the normal "
                    "force or the voltage changes it: the channel is saturated before its noise is "
                    "added; choose a wider range of the sensor or a smaller force",
                )
                return

    def end(self) -> Iterator[Finding]:
        if len({segment.direction for segment in self.segments}) < self.stroke.slides:
            yield Finding(
                "stopped half-way",
                "expected the finger to slide there and back, got one direction; repeat the stroke",
            )
            return
        force = self.recording.normal_force_n
        zero = float(force[self.before].mean())
        pressed = self.mean(force) - zero
        if abs(force[self.after].mean() - zero) > 0.5 * abs(pressed):
            yield Finding(
                "stopped half-way",
                "the recording ends before the finger has left the screen, so that drift cannot "
                f"be found; record {self.idle_s:g} s more",
                is_fatal=_still_sliding(self.recording),
            )

    def touched_early(self) -> Iterator[Finding]:
        before = self.recording.normal_force_n[self.before]
        if len(before) < _PARTS:
            return
        # Means of parts vary by a touch, hardly by noise.
        spread = float(np.ptp([part.mean() for part in np.array_split(before, _PARTS)]))
        largest = max(abs(self.level("normal_force_n")), self.stroke.normal_force_n)
        if spread > _EARLY_SHARE * largest:
            yield Finding(
                "never zeroed",
                f"the normal force changes by {spread:.3g} in the first {self.idle_s:g} s, when "
                "nothing should touch the screen: there is no zero to subtract; keep the finger "
                "off until the prompt",
            )

    def force_axes(self) -> Iterator[Finding]:
        planned = self.stroke.normal_force_n
        normal = self.level("normal_force_n")
        first_way = self.segments[0].direction
        drag = self.level("tangential_force_n", first_way) * first_way
        is_one_way = all(one.direction == first_way for one in self.segments)
        if not is_one_way:
            # Friction turns with the direction, the normal force does not.
            drag_back = self.level("tangential_force_n", -first_way) * -first_way
            one_way, back = (self.level("normal_force_n", way) for way in (first_way, -first_way))
            turns = abs(one_way - back) > abs(one_way + back)
            is_swapped = turns and abs(drag + drag_back) < abs(drag - drag_back)
            drag = (drag + drag_back) / 2
        else:
            is_swapped = abs(abs(drag) / planned - 1) < 0.3 and abs(normal) < 0.7 * planned
        if is_swapped:
            yield Finding(
                "swapped axes",
                f"the normal force reads {normal:.3g} N and the tangential one {drag:.3g} N, where "
                f"{planned:g} N were to be pressed; swap the two columns",
            )
        elif normal < -0.3 * planned:
            yield Finding(
                "wrong sign",
                f"expected a normal force of {planned:g} N, got {normal:.3g} N; give the column "
                "scale = -1",
            )
        elif unit := _unit(normal / planned, _FORCE_UNITS):
            yield _wrong_unit(f"a normal force of {planned:g} N", normal, unit)
        elif abs(normal) < _DEAD_MU * planned < abs(drag):
            yield _dead("normal_force_n", f"reads {normal:.2g} N in a slide with friction")
        elif normal <= 0.3 * planned:
            return
        elif abs(drag) < _DEAD_MU * normal:
            yield _dead("tangential_force_n", f"shows a friction of {drag / normal:.2g}")
        elif (mu := drag / normal) < 0:
            yield Finding(
                "wrong sign",
                f"the tangential force pulls the finger along (mu {mu:.3g}); give the column scale "
                "= -1, or turn x around",
            )
        elif mu - is_one_way * self.drift("tangential_force_n") * first_way / normal < _LOWEST_MU:
            unit = "kgf" if mu < 0.05 else "lbf"
            yield _wrong_unit(f"mu above {_LOWEST_MU:g}, with a tangential force in N", mu, unit)
        elif mu > _HIGHEST_MU:
            yield _wrong_unit(f"mu below {_HIGHEST_MU:g}, with a tangential force in N", mu, "mN")

    def zero(self) -> Iterator[Finding]:
        for name in _FORCES:
            level = float(np.median(getattr(self.recording, name)[self.before]))
            if abs(level) > _ZERO_SHARE * self.stroke.normal_force_n:
                yield Finding(
                    "never zeroed",
                    f"{name} reads {level:.3g} N before the touch; it is subtracted, but zero the "
                    "sensor so that its range is not used up",
                    is_fatal=False,
                )

    def off_target(self, tolerance: float) -> Iterator[Finding]:
        mean_speed = self.mean(np.abs(sliding_speed(self.recording.t_s, self.recording.x_mm)))
        stroke = self.stroke
        for what, unit, planned, measured, too_much, too_little in (
            ("force", "N", stroke.normal_force_n, self.level("normal_force_n"),
             "press less", "press harder"),
            ("speed", "mm/s", stroke.speed_mm_per_s, mean_speed, "slide slower", "slide faster"),
        ):  # fmt: skip
            error = measured / planned - 1
            if abs(error) > tolerance:
                yield Finding(
                    f"{what} off",
                    f"expected {planned:g} {unit} within {tolerance:.0%}, got {measured:.3g} "
                    f"{unit} ({error:+.0%}); {too_much if error > 0 else too_little}",
                )

    def drive(self) -> Iterator[Finding]:
        planned = self.stroke.voltage_v
        played = drive_amplitude(self.recording, self.segments)
        if abs(played - planned) > max(_DRIVE_TOLERANCE * planned, 1.0):
            yield Finding(
                "drive off",
                f"expected an amplitude of {planned:g} V, got {played:.4g} V on the screen; "
                "check amplifier, cable and the divider's scale",
            )
