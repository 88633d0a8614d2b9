"""Checks of a recording before it is reduced: each fault has a name and a remedy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from calibration.measure.clocks import sine_amplitude, sine_near
from calibration.measure.recording import SIGNALS, StrokeRecording
from calibration.measure.segmentation import Segment, full_slip, sliding_speed
from calibration.plan.parameters import Array

_IDLE_USED = 0.8  # of the untouched time, away from the touch
_SMOOTHING_S = 0.02  # as in `calibration.measure.segmentation`: several drive periods
_HIGHEST_MU = 5.0  # as in `haptix.model.status.LIMITS`: above it ozf or mN were read as N
_LOST_SHARE = 0.01
_ZERO_SHARE = 0.2  # of the planned force: a larger offset means that the sensor was not zeroed
_PARTS = 8  # of the untouched time
_EARLY_SHARE = 0.3  # of the planned force, while nothing should touch
_DRIVE_TOLERANCE = 0.05
_FULL_LENGTH = 0.9  # of the planned length
_LOWEST_MU = 0.08  # of a finger: below it lbf or kgf were read as N
_DEAD_MU = 0.02  # of a tangential channel that shows no friction
_SHOWS_SINE = 2.2  # samples in a period
_LOWEST_RATE_HZ = 1000.0  # ripples of the usual 125 Hz, and every start and stop, are seen above it
_LEAST_ALIAS_HZ = 20.0  # a ripple that looks slower than this does not average out in a slide
_HELD_SHARE = 0.4  # of repeated samples: every other one gives 0.5
_RIGID = 0.15  # of the tremor of the normal force: friction under voltage shows a third or more
_BENT, _BENT_FAR = 0.01, 0.05  # of a force: a zero that is bent is corrected, or refused
_SURELY_BENT = 6.0  # standard errors of the slopes of the idle parts
_LEAK_AGREES = 0.35  # of the time constants by the level and by the slope after the touch
# Friction lasts as long as the slide, or longer where skin stays stretched: it never ends before.
_LATE_S, _LATE_SAMPLES = 0.025, 3
_FLAT_SKEW = -0.5  # of the tangential force's fast part: a sine has 0, a spike above it

_FORCE_UNITS = {"mN": 1e3, "gf": 101.97, "kgf": 0.10197, "lbf": 0.22481, "ozf": 3.5969, "uN": 1e6}
_LENGTH_UNITS = {"m": 1e-3, "cm": 0.1, "inch": 1 / 25.4, "um": 1e3}
_FORCES = ("normal_force_n", "tangential_force_n")


@dataclass(frozen=True)
class Finding:
    """One fault of a recording."""

    kind: str
    """Kind of fault, such as "clipped force"."""
    message: str
    """The expected value, the found one, and the remedy."""
    is_fatal: bool = True
    """False where the reduction can correct it."""

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
    if any(finding.kind != "dropped samples" for finding in findings):
        return findings
    findings += _clipping(recording, idle_s)
    if length := list(_sliding(recording)):
        return findings + length
    if short := list(_lasts(recording, idle_s)):
        return findings + short
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
    # A force that leaks away looks like one in a wrong unit.
    bent = list(checks.bent())
    forces = [one for one in bent if one.kind == _LEAK] or list(checks.force_axes())
    findings += forces
    if not forces:  # in a wrong unit no other check of the forces means anything
        findings += checks.zero()
        findings += bent
        findings += checks.late_position()
        findings += checks.off_target(tolerance)
        if not any(finding.kind == "clipped force" for finding in findings):
            findings += checks.flattened()
    if "drive_v" not in recording.assumed:
        findings += checks.drive()
    return findings


_LEAK = "leaking charge"


def idle_parts(recording: StrokeRecording, idle_s: float) -> tuple[slice, slice]:
    """Samples before the touch and after it, while the finger is off."""
    t = recording.t_s
    used = _IDLE_USED * idle_s
    first = int(np.searchsorted(t, t[0] + used))
    last = int(np.searchsorted(t, t[-1] - used))
    return slice(0, max(first, 1)), slice(min(last, len(t) - 1), len(t))


@dataclass(frozen=True)
class Zero:
    """Reading without a force, from the idle parts: a line, or a cubic where slopes differ."""

    times_s: tuple[float, float]
    levels: tuple[float, float]
    slopes: tuple[float, float]
    """Middle of both idle parts, mean and slope there."""
    error: float
    """Standard error of a slope; infinite where a part is too short to tell."""

    @classmethod
    def of(cls, recording: StrokeRecording, name: str, idle_s: float) -> Zero:
        """Fit both idle parts of a signal; the errors are of means of parts, whatever the hum."""
        rows = []
        for part in idle_parts(recording, idle_s):
            blocks = np.array_split(np.arange(part.start, part.stop), _PARTS)
            filled = [block for block in blocks if len(block)]
            t, y = (
                np.array([values[part].mean() for part in filled])
                for values in (recording.t_s, getattr(recording, name))
            )
            slope, error = 0.0, np.inf
            if len(filled) == _PARTS:
                off = t - t.mean()
                slope = float(off @ y / (off @ off))
                rest = y - y.mean() - slope * off
                error = float(np.sqrt(rest @ rest / (_PARTS - 2) / (off @ off)))
            rows.append((float(t.mean()), float(y.mean()), slope, error))
        times, levels, slopes, errors = zip(*rows, strict=True)
        return cls(times, levels, slopes, float(np.sqrt(np.mean(np.square(errors)))))

    @property
    def lasts_s(self) -> float:
        """Time between the middles of both parts."""
        return self.times_s[1] - self.times_s[0]

    @property
    def _beside_line(self) -> tuple[float, float]:
        """Slopes less that of the line, where one of them surely differs from it."""
        line = (self.levels[1] - self.levels[0]) / self.lasts_s
        off = self.slopes[0] - line, self.slopes[1] - line
        is_bent = max(map(abs, off)) > _SURELY_BENT * self.error
        return off if is_bent else (0.0, 0.0)

    @property
    def bend(self) -> float:
        """Largest distance of the cubic from the line."""
        share = np.linspace(0.0, 1.0, 101)
        return float(np.abs(self._cubic(share)).max())

    def _cubic(self, share: Array) -> Array:
        """Hermite's cubic of the slopes beside the line."""
        first, last = self._beside_line
        rest = 1 - share
        return np.asarray(self.lasts_s * share * rest * (first * rest - last * share))

    def at(self, t_s: Array) -> Array:
        """Return the reading at some times, shape (samples,)."""
        share = (t_s - self.times_s[0]) / self.lasts_s
        line = self.levels[0] + share * (self.levels[1] - self.levels[0])
        return np.asarray(line + self._cubic(share.clip(0, 1)))


def drive_amplitude(recording: StrokeRecording, segments: list[Segment]) -> float:
    """Amplitude [V] at the stroke's frequency, over parts of a recording.

    The planned one where the recording is too slow to show it.
    """
    frequency_hz = recording.stroke.frequency_hz
    if recording.sample_rate_hz < _SHOWS_SINE * frequency_hz:
        return recording.stroke.voltage_v
    amplitudes = [
        sine_amplitude(recording.t_s[part.samples], recording.drive_v[part.samples], frequency_hz)
        for part in segments
    ]
    return float(np.mean(amplitudes))


def drive_frequency(recording: StrokeRecording, segments: list[Segment]) -> float:
    """Frequency [Hz] of the drive by the recording's clock, over parts of it.

    The planned one where the recording does not show the drive.
    """
    stroke = recording.stroke
    is_slow = recording.sample_rate_hz < _SHOWS_SINE * stroke.frequency_hz
    if is_slow or not stroke.voltage_v or "drive_v" in recording.assumed:
        return stroke.frequency_hz
    parts = [part.samples for part in segments]
    found = [
        sine_near(recording.t_s[part], recording.drive_v[part], stroke.frequency_hz)[0]
        for part in parts
    ]
    return float(np.mean(found))


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
    if usual < 0.5 * step.mean():
        yield Finding(
            "wrong times",
            "the times come in bursts, and beside an even clock samples are missing or the rate "
            "changes; export the instrument's own clock, or check its buffer",
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


def _lasts(recording: StrokeRecording, idle_s: float) -> Iterator[Finding]:
    """Find a slide of full length for which there was no time between the idle parts."""
    lasted = float(recording.t_s[-1] - recording.t_s[0])
    if lasted < 2 * idle_s:
        yield Finding(
            "wrong times",
            f"expected a slide of some {recording.stroke.sliding_s:.2g} s between {idle_s:g} s "
            f"without touch on either side, got {lasted:.3g} s in all: are the times in another "
            "unit? Say so in the column map",
        )


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


def force_unit(ratio: float) -> str | None:
    """Unit of a force that reads `ratio` times as much as in newtons; None where none fits."""
    return _unit(ratio, _FORCE_UNITS)


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
        chosen = [segment for segment in self.segments if direction in (None, segment.direction)]
        return float(np.concatenate([values[segment.samples] for segment in chosen]).mean())

    def dead(self) -> Iterator[Finding]:
        for name in _FORCES:
            if not np.ptp(getattr(self.recording, name)) > 0:
                yield _dead(name, "does not change at all")

    def held(self) -> Iterator[Finding]:
        """Values that stand for several samples: the ripple is lower than it was."""
        for name in _FORCES:
            values = getattr(self.recording, name)
            steps = np.abs(
                np.concatenate([np.diff(values[segment.samples]) for segment in self.segments])
            )
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
        for segment in self.segments:
            shear = segment.direction * self.recording.tangential_force_n[segment.samples]
            press = self.recording.normal_force_n[segment.samples]
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

    def late_position(self) -> Iterator[Finding]:
        """Slides that go on, by their position, after friction has ended: two clocks."""
        t, step = self.recording.t_s, 1 / self.recording.sample_rate_hz
        width = max(round(_SMOOTHING_S / step), 1)
        press, shear = (
            uniform_filter1d(values - np.median(values[self.before]), width)
            for values in (getattr(self.recording, name) for name in _FORCES)
        )
        velocity = sliding_speed(t, self.recording.x_mm)
        late_s = []
        for segment in self.segments:
            way, sliding = segment.direction, segment.samples
            middle = (segment.start + segment.stop) // 2
            moves = way * velocity[middle:] > np.median(way * velocity[sliding]) / 2
            end = middle + (len(moves) if moves.all() else int(moves.argmin()))
            # Of both forces the upper quarter: with a late position some of the slide has none.
            drag, pressed = np.percentile([way * shear[sliding], press[sliding]], 75, axis=1)
            touching = press[middle:end] > pressed / 2
            drags = touching & (way * shear[middle:end] > drag / pressed / 2 * press[middle:end])
            last = np.flatnonzero(drags)[-1] if drags.any() else 0
            late_s.append(step * int(touching[last + 1 :].sum()))
        late = float(np.median(late_s))
        if late > max(_LATE_S, _LATE_SAMPLES * step):
            yield Finding(
                "late position",
                f"by its position the finger slides for {1e3 * late:.0f} ms or more after friction "
                "has ended: x_mm comes later than the forces; record both by one clock, or take "
                "off the delay of the position's sensor or file",
            )

    def end(self) -> Iterator[Finding]:
        if len({segment.direction for segment in self.segments}) < min(self.stroke.slides, 2):
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
        is_one_way = all(segment.direction == first_way for segment in self.segments)
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
        elif unit := force_unit(normal / planned):
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
            unit = "mN" if mu > 10 * _HIGHEST_MU else "ozf"
            yield _wrong_unit(f"mu below {_HIGHEST_MU:g}, with a tangential force in N", mu, unit)

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

    def bent(self) -> Iterator[Finding]:
        """A zero that curves between the idle parts: a sensor that warms up, or a leak of charge.

        A charge amplifier forgets a force: the loss during the touch stands below zero after
        it, and comes back at the same rate.
        """
        t, planned = self.recording.t_s, self.stroke.normal_force_n
        for name in _FORCES:
            values = getattr(self.recording, name)
            zero = Zero.of(self.recording, name, self.idle_s)
            ways = {segment.direction for segment in self.segments}
            size = max(abs(self.level(name, way)) for way in ways)
            if zero.bend <= _BENT * size:
                continue
            left = zero.levels[1] - zero.levels[0]
            until = t <= zero.times_s[1]
            charge = float(np.trapezoid((values - zero.levels[0])[until], t[until]))
            by_level, by_slope = -left / charge if charge else 0.0, -zero.slopes[1] / (left or 1.0)
            is_leak = by_level > 0 and abs(by_slope / by_level - 1) < _LEAK_AGREES
            if is_leak and abs(zero.slopes[0]) < _SURELY_BENT * zero.error:
                yield Finding(
                    _LEAK,
                    f"{name} falls back with a time constant of {1 / by_level:.2g} s, as a charge "
                    f"amplifier does: after the touch it reads {left:.3g} N; set its longest time "
                    "constant, or take a sensor that measures at rest",
                )
                continue
            if 2 * abs(self.drift("normal_force_n")) > _EARLY_SHARE * planned:
                continue  # the finger is still on the screen
            is_far = zero.bend > _BENT_FAR * size
            remedy = "let the sensor warm up, and repeat" if is_far else "it is subtracted"
            yield Finding(
                "bent zero",
                f"the zero of {name} bends by {zero.bend:.2g} N ({zero.bend / size:.1%} of the "
                f"force) between begin and end of the recording; {remedy}",
                is_fatal=is_far,
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
