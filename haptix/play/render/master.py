"""Master controls of a renderer: intensity, mute, pause, and short effects added to the texture."""

from __future__ import annotations

import logging
from collections.abc import Callable
from math import ceil, inf, isfinite, nan
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from haptix.base.checks import Array, number, whole
from haptix.base.errors import InputError
from haptix.feel.layout.region_state import Glide
from haptix.feel.materials import Evaluator, Feelable, check_feelable
from haptix.feel.motion import Facts, Motion

_LOG = logging.getLogger("haptix.play.render")

MOST_EFFECTS = 8
"""Largest number of effects at once; one more drops the oldest of the lowest priority."""

_CHANGE_S = 0.05  # duration of a change of the intensity
_MUTE_S = 0.005
_FELT_GAIN = 0.5  # a finger feels an effect if it gets at least this share of its amplitude
_FELT_S = 1e-3  # step in which `PlayingEffect.mark` records whether an effect is felt

Outcome = Literal["played", "cut", "dropped"]


class EffectEnd(NamedTuple):
    """How an effect ended."""

    effect: Any
    sample: int
    """Index of the sample at which it ended."""
    outcome: Outcome
    """Whether it was played to its end, was stopped (cut), or was dropped for another effect."""
    felt_share: float
    """Share of its time in which a finger got drive; a finger that rests feels nothing."""


class PlayingEffect:
    """An effect while it is played.

    Parameters
    ----------
    effect : object
        Requested value.
    evaluator : Evaluator
        Its answers.
    now : callable
        Returns the time of the scene [s].
    length_s : float
        How long it plays [s].
    priority : int
        Of too many effects the one of lowest priority is dropped.
    done : callable or None
        Takes its `EffectEnd`.
    changed : callable
        Called when it ends early.
    """

    def __init__(
        self,
        effect: Any,
        evaluator: Evaluator,
        now: Callable[[], float],
        length_s: float,
        priority: int,
        done: Callable[[EffectEnd], None] | None,
        changed: Callable[[], None],
    ) -> None:
        self.effect, self.priority, self.done = effect, priority, done
        self._changed = changed
        self.evaluator = evaluator
        self._now = now
        self.start_s = now()
        self.end_s = self.start_s + length_s
        self.fade = Glide.resting(1.0)
        self.outcome: Outcome = "played"
        self.felt = np.zeros(max(1, ceil(length_s / _FELT_S)), bool)
        """Whether a finger felt it, for each millisecond."""

    def added(self, motion: Motion) -> Array:
        """Share of the reachable friction that the effect adds."""
        begun = Facts(0.0, 0.0, 0.0, 0.0, 0.0)
        moved = motion.begun_at(self.start_s, ((((-inf, begun),)),) * motion.fingers)
        value = self.evaluator.wanted(moved)
        if self.evaluator.target == "contrast":
            low, high = motion.reach
            value = value * low / np.maximum(high - low, 1e-9 * low)
        value = np.where(motion.t_s < self.end_s, value, 0.0)
        if self.fade.after[0] == 1.0:
            return value
        return value * (1 - self.fade.parts(motion.t_s))

    @property
    def fades_s(self) -> tuple[float, float]:
        """When it begins and ends to fade out; infinite if it does not."""
        return (self.fade.start_s, self.fade.end_s) if self.fade.after[0] != 1.0 else (inf, inf)

    def mark(self, t_s: Array, is_felt: npt.NDArray[np.bool_]) -> None:
        """Record whether the effect is felt at times of the scene.

        Parameters
        ----------
        t_s : array, shape (points,)
        is_felt : array of bool, shape (points,)
            Whether a finger feels it then.
        """
        at = np.floor((t_s - self.start_s) / _FELT_S).astype(int)
        inside = (at >= 0) & (at < len(self.felt))
        self.felt[at[inside]] = is_felt[inside]

    @property
    def felt_share(self) -> float:
        """Share of the effect's time in which it is felt."""
        count = min(max(1, round((self.end_s - self.start_s) / _FELT_S)), len(self.felt))
        return float(self.felt[:count].mean())

    def stop(self, outcome: Outcome = "cut") -> None:
        """Fade the effect out in 5 ms."""
        now_s = self._now()
        if now_s < self.end_s:
            self.outcome = outcome
            self.fade = Glide((1.0,), (0.0,), now_s, now_s + _MUTE_S)
            self.end_s = now_s + _MUTE_S
            self._changed()


class Mix(NamedTuple):
    """Intensity and effects of one block."""

    since_s: float = 0.0
    """Time of the scene at the block's start, a step before its first point."""
    intensity: float | Array = 1.0
    """Intensity at the points, shape (points,), or one number if it is constant."""
    effects: tuple[PlayingEffect, ...] = ()
    stands: bool = False
    """Whether the time of the scene stands."""

    def added(self, motion: Motion) -> Array:
        """Share of the reachable friction that the effects add to a motion."""
        return np.asarray(np.sum([effect.added(motion) for effect in self.effects], axis=0))

    def mark(self, motion: Motion, gain: Array) -> None:
        """Record whether fingers of such gains feel the effects, unless their time stands."""
        if self.stands:
            return
        t_s = self.since_s + motion.step_s * np.arange(1.0, motion.points + 1)
        is_felt = gain.reshape(-1, motion.points).max(axis=0, initial=0.0) > _FELT_GAIN
        for effect in self.effects:
            effect.mark(t_s, is_felt)


class Master:
    """Intensity and effects of a session; any thread may change them.

    The intensity scales friction above the lowest, ``mu = low + I (mu - low)``, and so never raises
    a voltage.

    Parameters
    ----------
    changed : callable
        Called after each change.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self.intensity = self.person_intensity = 1.0
        self.is_muted = self.is_paused = False
        self._stood_s = self._stands_s = 0.0
        self._line = Glide.resting(1.0)
        self._effects: tuple[PlayingEffect, ...] = ()  # replaced, never changed
        self._ended: tuple[PlayingEffect, ...] = ()

    def reset(self) -> None:
        """Start a session: without effects or pauses, at the set intensity."""
        self._effects = self._ended = ()
        self.is_paused = False
        self._stood_s = 0.0
        self._line = Glide.resting(self._goal)

    @property
    def _goal(self) -> float:
        is_silent = self.is_muted or self.is_paused
        return 0.0 if is_silent else self.intensity * self.person_intensity

    def turn(self, now_s: float, **changes: Any) -> None:
        """Set attributes, and move the intensity to the new value along a line from `now_s` on."""
        quick = False
        for name, value in changes.items():
            if isinstance(value, bool):
                quick = True
            elif not 0 <= number(name, value) <= 1:
                raise InputError(f"{name}: expected 0 to 1, got {value:g}")
            setattr(self, name, value)
        _LOG.info("%s", ", ".join(f"{name} {value}" for name, value in changes.items()))
        self._line = self._line.to((self._goal,), now_s, _MUTE_S if quick else _CHANGE_S)
        self._changed()

    def pause(self, now_s: float) -> None:
        """Stop the time of the scene from `now_s` on, and fade out."""
        if not self.is_paused:
            self._stands_s = self.scene_s(now_s)
            self.turn(now_s, is_paused=True)

    def resume(self, now_s: float) -> None:
        """Let the time of the scene go on from `now_s` on, and fade in."""
        if self.is_paused:
            self._stood_s = now_s - self._stands_s
            self.turn(now_s, is_paused=False)

    def scene_s(self, samples_s: float) -> float:
        """Time of the scene at a time of samples: that time minus all pauses."""
        return self._stands_s if self.is_paused else samples_s - self._stood_s

    def mix(self, first_s: float, step_s: float, points: int) -> Mix:
        """Return the mix of a block that starts at a time of samples."""
        since_s, line = self.scene_s(first_s), self._line
        if first_s >= line.end_s:
            return Mix(since_s, line.after[0], self._effects, self.is_paused)
        (low,), (high,) = line.before, line.after
        parts = line.parts(first_s + step_s * np.arange(1.0, points + 1))
        return Mix(since_s, low + parts * (high - low), self._effects, self.is_paused)

    @property
    def compiled(self) -> tuple[float, ...]:
        """The numbers of an ``hx_mix`` of the engine, without the effects."""
        line, stands_s = self._line, self._stands_s if self.is_paused else nan
        return (*line.before, *line.after, line.start_s, line.end_s, self._stood_s, stands_s)

    @property
    def effects(self) -> tuple[PlayingEffect, ...]:
        """Effects that play, or have played."""
        return self._effects

    def play(
        self,
        effect: Feelable,
        now: Callable[[], float],
        priority: int = 0,
        done: Callable[[EffectEnd], None] | None = None,
    ) -> PlayingEffect:
        """Begin an effect by the clock of the scene; see `LiveRenderer.play`."""
        check_feelable("effect", effect)
        evaluator = effect.evaluator
        length_s = getattr(effect, "length_s", None)
        if length_s is None or not isfinite(length_s) or evaluator.target == "mu":
            raise InputError(
                "effect: expected one that ends and is a share or a contrast of friction, such as "
                f"haptix.feel.materials.Transient, got a {type(effect).__name__}"
            )
        whole("priority", priority, -(10**6))
        now_s = now()
        playing = [other for other in self._effects if other.end_s > now_s]
        added = PlayingEffect(effect, evaluator, now, length_s, priority, done, self._changed)
        whole_ones = [other for other in playing if other.outcome == "played"]
        if len(whole_ones) >= MOST_EFFECTS:
            weakest = min([*whole_ones, added], key=lambda other: (other.priority, other.start_s))
            _LOG.info("an effect is dropped: %d play already", MOST_EFFECTS)
            weakest.stop("dropped")
        self._ended += tuple(other for other in self._effects if other.end_s <= now_s)
        self._effects = (*playing, added)
        self._changed()
        return added

    def cut(self, played_s: float, sample_rate_hz: float) -> None:
        """End all effects at the end of the session."""
        for effect in self._effects:
            if effect.end_s > played_s:
                effect.end_s, effect.outcome = played_s, "cut"
        self.ended(played_s, sample_rate_hz)

    def ended(self, played_s: float, sample_rate_hz: float) -> list[EffectEnd]:
        """Return the effects that have ended by a time of the scene, and call their `done`.

        Each effect is returned once.
        """
        over = [*self._ended, *(effect for effect in self._effects if effect.end_s <= played_s)]
        if not over:
            return []
        self._ended = ()
        self._effects = tuple(effect for effect in self._effects if effect not in over)
        ends = []
        for effect in over:
            sample = round((effect.end_s + self._stood_s) * sample_rate_hz)
            end = EffectEnd(effect.effect, sample, effect.outcome, effect.felt_share)
            ends.append(end)
            if effect.done is not None:
                effect.done(end)
        return ends
