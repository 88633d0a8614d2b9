"""Designs of sets: full factorial, constant stimuli, matched intensity, equal friction."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from itertools import product
from math import log10, pi, prod, sqrt
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from haptix.base.checks import choice, number, positive, whole
from haptix.base.documents import Part
from haptix.base.errors import InputError
from haptix.feel.signals.shapes import Sine
from haptix.feel.signals.signal import signal_from
from haptix.lab.stimuli.stimulus import Stimulus, stimulus_from
from haptix.model.perception.thresholds import Perception
from haptix.model.presets import DEFAULT_CARRIER_HZ
from haptix.model.screen import Screen
from haptix.play.devices import DriveLimits

_MOST_STIMULI = 10_000  # of a design; an experiment has some hundreds
_BLOCK = 1 << 16  # samples


def full_factorial(
    name: str, make: Callable[..., Stimulus], /, **factors: Sequence[Any]
) -> list[Stimulus]:
    """Every combination of some factors' values, which become the stimuli's conditions.

    ``make(name, **values)`` returns a stimulus. Names begin with `name`; a number follows.
    """
    for factor, values in factors.items():
        if isinstance(values, str) or not len(values):
            raise InputError(f"{factor}: expected one value or more")
    count = prod(map(len, factors.values()))
    if count > _MOST_STIMULI:
        raise InputError(f"factors: expected at most {_MOST_STIMULI} combinations, got {count}")
    combinations = list(product(*factors.values()))
    digits = max(2, len(str(len(combinations))))
    stimuli = []
    for index, values in enumerate(combinations, 1):
        chosen = dict(zip(factors, values, strict=True))
        stimuli.append(_with_conditions(make(f"{name}-{index:0{digits}d}", **chosen), chosen))
    return stimuli


def constant_stimuli(
    name: str, make: Callable[[str, float], Stimulus], threshold: float, steps_db: Sequence[float]
) -> list[Stimulus]:
    """Stimuli at levels ``20 log10(amplitude / threshold)`` about a detection threshold.

    ``make(name, amplitude)`` returns a stimulus. Names begin with `name`; a number follows.
    """
    positive("threshold", threshold)
    if not len(steps_db):
        raise InputError("steps_db: expected one level or more")
    stimuli = []
    for index, step in enumerate(steps_db, 1):
        number("steps_db", step)
        amplitude = float(threshold * 10 ** (step / 20))
        stimulus = make(f"{name}-{index:02d}", amplitude)
        stimuli.append(_with_conditions(stimulus, {"level_db": step, "amplitude": amplitude}))
    return stimuli


def matched_intensity(
    name: str,
    felt_hz: Sequence[float],
    sensation_db: float,
    length_s: float,
    drive: Literal["direct", "carrier"] = "direct",
    normal_force_n: float = 0.5,
    carrier_hz: float = DEFAULT_CARRIER_HZ,
    perception: Perception | None = None,
    fade_s: float = 0.05,
    limits: DriveLimits | None = None,
) -> list[Stimulus]:
    """Tones of several felt frequencies at one sensation level, by the rule of two channels.

    Parameters
    ----------
    name : str
        Beginning of the stimuli's names; the frequency follows.
    felt_hz : sequence of float
        Frequencies of the attraction [Hz].
    sensation_db : float
        Level above the detection threshold of the mediating channel [dB].
    length_s, fade_s : float
        Length, and the part of it that each fade takes [s].
    drive : {"direct", "carrier"}
        A sine of half the felt frequency; or a carrier whose attraction is a raised sine of the
        felt frequency. The carrier takes sqrt(2) times the amplitude for the same attraction, if
        the dispersion of skin and insulator between the two frequencies is neglected.
    normal_force_n, carrier_hz : float
        Normal force of the touch, and frequency of the carrier.
    perception : Perception, optional
        Detection thresholds; by default those of the package.
    limits : DriveLimits, optional
        Of the drive; by default those of the product.

    Raises
    ------
    InputError
        If there are no thresholds at a frequency, or the level takes more voltage than the limits
        admit. The message has the highest level that all tones can have.
    """
    known = Perception.default() if perception is None else perception
    number("sensation_db", sensation_db)
    choice("drive", drive, ("direct", "carrier"))
    highest_db, at_hz = highest_level(felt_hz, drive, carrier_hz, known, limits or DriveLimits())
    if sensation_db > highest_db:
        raise InputError(
            f"sensation_db: {sensation_db:g} dB is not possible; at most {highest_db:.1f} dB is, "
            f"limited by the tone felt at {at_hz:g} Hz: lower the level, or leave that tone out"
        )
    stimuli = []
    for felt in felt_hz:
        positive("felt_hz", felt)
        channel = known.channel_at(felt)
        volts = 10 ** ((channel.threshold(felt) + sensation_db) / 20)
        if drive == "direct":
            tone = Sine(volts, felt / 2)
        else:
            # The square of this amplitude is V^2 (1 + sin 2 pi f t) / 2: a raised sine.
            tone = Sine(sqrt(2) * volts, felt / 2, phase_rad=pi / 4)
        stimulus = Stimulus(
            f"{name}-{felt:g}Hz",
            tone.lasting(length_s).window(fade_s),
            "volts",
            normal_force_n,
            carrier_hz if drive == "carrier" else None,
            felt / 2 if drive == "direct" else None,
        )
        conditions = {
            "felt_hz": felt,
            "sensation_db": sensation_db,
            "channel": channel.name,
            "threshold_is_placeholder": channel.is_placeholder,
        }
        stimuli.append(_with_conditions(stimulus, conditions))
    return stimuli


def highest_level(
    felt_hz: Sequence[float],
    drive: Literal["direct", "carrier"],
    carrier_hz: float,
    known: Perception,
    limits: DriveLimits,
) -> tuple[float, float]:
    """Highest sensation level [dB] that tones can all have, and the frequency that limits it [Hz].

    Parameters are those of `matched_intensity`.
    """
    levels = []
    for felt in felt_hz:
        at = positive("felt_hz", felt)
        volts = limits.highest_sine_v(at / 2 if drive == "direct" else carrier_hz)
        # A carrier takes sqrt(2) times the amplitude.
        sine_v = volts if drive == "direct" else volts / sqrt(2)
        levels.append((20 * log10(sine_v) - known.channel_at(at).threshold(at), at))
    if not levels:
        raise InputError("felt_hz: expected one frequency or more")
    return min(levels)


def equal_mean(
    stimuli: Sequence[Stimulus], mean: float, sample_rate_hz: float = 48_000.0
) -> list[Stimulus]:
    """Shift the signals of stimuli so that all have one mean, in their quantity.

    In mu, contrast and share the friction is that of the signal, so that the stimuli have equal
    mean friction at one force; sidecars have the prediction (``friction.mean``). The shift is a
    condition of each. Raises `InputError` if a stimulus is in volts, or the quantities or forces
    differ.
    """
    touches = {(stimulus.quantity, stimulus.normal_force_n) for stimulus in stimuli}
    if len(touches) > 1 or any(stimulus.quantity == "volts" for stimulus in stimuli):
        raise InputError(
            "equal mean friction: expected stimuli of one force, and of one quantity that is "
            "friction: mu, contrast or share"
        )
    shifted_stimuli = []
    for stimulus in stimuli:
        count = stimulus.signal.samples(sample_rate_hz) or 0
        total = sum(
            float(stimulus.signal.values(first, min(_BLOCK, count - first), sample_rate_hz).sum())
            for first in range(0, count, _BLOCK)
        )
        shift = float(mean - total / max(count, 1))
        shifted = replace(stimulus, signal=(stimulus.signal + shift).lasting(stimulus.length_s))
        shifted_stimuli.append(_with_conditions(shifted, {"shift": shift}))
    return shifted_stimuli


def equal_friction(
    stimuli: Sequence[Stimulus], screens: Sequence[Screen]
) -> tuple[tuple[Stimulus, ...], tuple[Screen, ...]]:
    """Check that a set asks for the same friction on several screens, in volts of their own.

    Raises `InputError` if there are fewer than two screens, or a stimulus is in volts or relative
    to each screen.
    """
    if len(screens) < 2:
        raise InputError("equal friction: expected two screens or more")
    for stimulus in stimuli:
        if stimulus.quantity != "mu":
            raise InputError(
                f'{stimulus.name}: equal friction needs the quantity "mu", '
                f"got {stimulus.quantity!r}"
            )
    return tuple(stimuli), tuple(screens)


def variants_of(stimuli: Sequence[Stimulus], count: int) -> list[Stimulus]:
    """Draw each stimulus `count` times, with seeds of its own, as the condition ``variant``.

    The seeds follow from those of the stimulus and the variant's number, so that variant 3 of two
    stimuli with one seed is the same draw. The first variant is the stimulus as it is. Names end in
    ``-v1`` and so on. Raises `InputError` if a stimulus has nothing random in it, or there are too
    many.
    """
    whole("variants", count, 1)
    if len(stimuli) * count > _MOST_STIMULI:
        raise InputError(
            f"variants: expected at most {_MOST_STIMULI} stimuli, got {len(stimuli) * count}"
        )
    variants = []
    for stimulus in stimuli:
        if not stimulus.signal.seeds:
            raise InputError(f"{stimulus.name}: variants: nothing in it is random; leave them out")
        for number_ in range(1, count + 1):
            table = _reseeded(stimulus.signal.describe(), number_)
            named = replace(stimulus, name=f"{stimulus.name}-v{number_}", signal=signal_from(table))
            variants.append(_with_conditions(named, {"variant": number_}))
    return variants


def _reseeded(table: Any, variant: int) -> Any:
    """Give all seeds of a description those of a variant."""
    if isinstance(table, list):
        return [_reseeded(item, variant) for item in table]
    if not isinstance(table, dict):
        return table
    inner = {key: _reseeded(value, variant) for key, value in table.items()}
    if variant > 1 and isinstance(inner.get("seed"), int):
        inner["seed"] = int(np.random.SeedSequence([inner["seed"], variant]).generate_state(1)[0])
    return inner


def stimulus_maker(base: Mapping[str, Any], place: str) -> Callable[..., Stimulus]:
    """Return ``make(name, **values)``, which puts values at dotted places of a table."""

    def make(name: str, /, **values: Any) -> Stimulus:
        table: Any = deepcopy(base)
        for dotted, value in values.items():
            put(table, dotted, value, place)
        return stimulus_from(name, table)

    return make


def put(table: Any, dotted: str, value: Any, place: str) -> None:
    """Put a value at a dotted place of a table; raise `InputError` if there is no such place."""
    *path, last = dotted.split(".")
    at = table
    try:
        for step in path:
            at = at[int(step)] if isinstance(at, list) else at[step]
        if isinstance(at, list):
            at[int(last)] = value
        else:
            at[last] = value
    except (KeyError, IndexError, ValueError, TypeError):
        raise InputError(
            f"{place}.{dotted}: there is no such place in the base; write it as in "
            '"signal.frequency_hz" or "signal.parts.0.amplitude"'
        ) from None


def _with_conditions(stimulus: Stimulus, more: Mapping[str, Any]) -> Stimulus:
    return replace(stimulus, conditions={**stimulus.conditions, **more})


Table = dict[str, Any]


class FactorialDesign(Part):
    """Every combination of values put at dotted places of a base stimulus.

    For equal friction the stimuli are in mu, rendered for each of several screens. For equal mean
    friction they are shifted to one `mean`, in their quantity. `variants` draws each several times,
    with other seeds.
    """

    kind: Literal["factorial", "equal-friction", "equal-mean-friction"]
    name: str
    base: Table
    factors: dict[str, list[Any]] = Field(default={})
    variants: Annotated[int, Field(ge=1)] = 1
    mean: float | None = None

    @model_validator(mode="after")
    def _has_a_mean(self) -> Self:
        if (self.mean is None) == (self.kind == "equal-mean-friction"):
            raise ValueError("mean: expected with equal-mean-friction, and only with it")
        return self

    def stimuli(self, known: Perception, limits: DriveLimits) -> list[Stimulus]:
        """Make the stimuli; without factors only the base, under the design's name."""
        if self.factors:
            make = stimulus_maker(self.base, f"{self.name}.factors")
            stimuli = full_factorial(self.name, make, **self.factors)
        else:
            stimuli = [stimulus_from(self.name, self.base)]
        stimuli = variants_of(stimuli, self.variants) if self.variants > 1 else stimuli
        return stimuli if self.mean is None else equal_mean(stimuli, self.mean)


class ConstantStimuliDesign(Part):
    """Stimuli of one design whose levels are in dB relative to a detection threshold."""

    kind: Literal["constant-stimuli"]
    name: str
    base: Table
    vary: str = "signal.amplitude"
    threshold: PositiveFloat
    steps_db: list[float]

    def stimuli(self, known: Perception, limits: DriveLimits) -> list[Stimulus]:
        """Make the stimuli of the design."""
        make = stimulus_maker(self.base, f"{self.name}.vary")
        return constant_stimuli(
            self.name, lambda name, at: make(name, **{self.vary: at}), self.threshold, self.steps_db
        )


class MatchedIntensityDesign(Part):
    """Tones at one level above the detection threshold."""

    kind: Literal["matched-intensity"]
    name: str
    felt_hz: list[float]
    sensation_db: float
    length_s: PositiveFloat
    drive: Literal["direct", "carrier"] = "direct"
    normal_force_n: PositiveFloat = 0.5
    carrier_hz: PositiveFloat = DEFAULT_CARRIER_HZ
    fade_s: Annotated[float, Field(ge=0)] = 0.05

    def stimuli(self, known: Perception, limits: DriveLimits) -> list[Stimulus]:
        """Make the stimuli of the design."""
        fields = self.model_dump(exclude={"kind"})
        return matched_intensity(**fields, perception=known, limits=limits)


Design = Annotated[
    FactorialDesign | ConstantStimuliDesign | MatchedIntensityDesign, Field(discriminator="kind")
]
