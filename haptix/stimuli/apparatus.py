"""The fingers and the screen of a set, with the lookup surfaces that render its stimuli."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np

from haptix.checks import Array
from haptix.devices import BODY_CAPACITANCE_F, DriveLimits
from haptix.errors import InputError
from haptix.finger import Finger
from haptix.finger_response import FingerResponse
from haptix.friction import ContactModel
from haptix.population import Population
from haptix.render.drive import DirectWave
from haptix.screen import Screen
from haptix.stimuli.stimulus import Stimulus
from haptix.surface import Column, FrictionSurface, cached_surface

TOLERANCE = "0.02 thresholds"
"""Tolerance of the surfaces; a stimulus may be off by a quarter of a JND in all."""

_PLACES = 257  # of a speed profile, over the stimulus
_NODES = 65  # amplitudes at which a contact is solved


@dataclass(frozen=True)
class ContactTable:
    """Contact of the first finger against the amplitude of the drive, linear between its nodes.

    All stimuli of one touch use it, so that none depends on which others are made with it.
    """

    amplitude_v: Array
    """Amplitudes [V], increasing from 0, shape (nodes,); the others have the same shape."""
    capacitance_f: Array
    conductance_s: Array
    pull_past_breakdown: Array
    x: float
    """``p0/(E* slope)``, see `haptix.states.ContactState`."""

    def at(self, name: str, amplitude_v: float) -> float:
        """Return one of the tables at an amplitude; that of the last node above it."""
        return float(np.interp(amplitude_v, self.amplitude_v, getattr(self, name)))


@dataclass(frozen=True, eq=False)
class Apparatus:
    """Fingers on a screen.

    Parameters
    ----------
    models : tuple of ContactModel
        One per finger; the same screen in all.
    surfaces : tuple of FrictionSurface
        One per finger.
    fingers : str
        Name of the one finger, or how several were drawn.
    """

    models: tuple[ContactModel, ...]
    surfaces: tuple[FrictionSurface, ...]
    fingers: str
    _known: dict[Any, Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.models or len(self.models) != len(self.surfaces):
            raise InputError("models and surfaces: expected one surface for each finger")

    @classmethod
    def build(
        cls,
        finger: Finger | Population,
        screen: Screen,
        stimuli: Sequence[Stimulus],
        ceiling_v: float | None = None,
    ) -> Apparatus:
        """Build, or find in the cache, the surfaces that some stimuli need.

        The stimuli's forces, frequencies and thicknesses are the ranges of the surfaces. The
        highest amplitude is `ceiling_v` [V], but never above the screen's limit.
        """
        return cls.over(finger, screen, cls.ranges(screen, stimuli, ceiling_v))

    @classmethod
    def over(
        cls, finger: Finger | Population, screen: Screen, ranges: Mapping[str, Any]
    ) -> Apparatus:
        """Build, or find in the cache, the surfaces over some `ranges`."""
        people = finger.fingers if isinstance(finger, Population) else (finger,)
        names = finger.statement if isinstance(finger, Population) else finger.name
        models = tuple(ContactModel(one, screen) for one in people)
        surfaces = tuple(cached_surface(model, ranges, TOLERANCE)[0] for model in models)
        return cls(models, surfaces, names)

    @staticmethod
    def ranges(
        screen: Screen, stimuli: Sequence[Stimulus], ceiling_v: float | None = None
    ) -> dict[str, Any]:
        """Ranges of the surfaces that some stimuli need, see `build`."""
        forces = [one.normal_force_n for one in stimuli]
        frequencies = []
        for one in stimuli:
            if one.frequency_hz is None:
                raise InputError(
                    f"{one.name}: drive_hz: expected the frequency of the drive, at which skin and "
                    "insulator are taken, since there is no carrier"
                )
            frequencies.append(one.frequency_hz)
        thicknesses = [screen.h0_m if one.h0_m is None else one.h0_m for one in stimuli]
        return {
            "normal_force_n": (min(forces), max(forces)),
            "frequency_hz": (min(frequencies), max(frequencies)),
            "h0_m": (min(thicknesses), max(thicknesses)),
            "voltage_v": (0.0, min(ceiling_v or screen.max_voltage_v, screen.max_voltage_v)),
        }

    @property
    def screen(self) -> Screen:
        """The screen."""
        return self.models[0].screen

    def responses(self, stimulus: Stimulus) -> tuple[Column, tuple[Column, ...]]:
        """Return the median finger's response to a stimulus's drive, and that of each.

        Without a carrier friction is the mean over a period of a sine. The finger follows the
        ripple of the attraction by its response at the stimulus's speeds, and wholly where no speed
        is given.
        """
        ripple = [_ripple(stimulus, one.response_hz_per_mm_per_s) for one in self.surfaces]
        touch = stimulus.normal_force_n, stimulus.frequency_hz, stimulus.h0_m
        key = ("responses", *touch, *(None if one is None else one.tobytes() for one in ripple))
        if key not in self._known:
            # The current through a person limits fast carriers below the ceiling.
            body_f = max(self.screen.body_capacitance_f, BODY_CAPACITANCE_F)
            highest_v = DriveLimits(capacitance_f=body_f).highest_sine_v(touch[1] or 0.0)
            each = tuple(
                surface.column(*touch, one).limited(highest_v)
                for surface, one in zip(self.surfaces, ripple, strict=True)
            )
            self._known[key] = Column.median(each), each
        columns: tuple[Column, tuple[Column, ...]] = self._known[key]
        return columns

    def contact(self, stimulus: Stimulus) -> ContactTable:
        """Contact of the first finger at a stimulus's force and drive, up to the ceiling."""
        touch = stimulus.normal_force_n, stimulus.frequency_hz, stimulus.h0_m
        key = ("contact", *touch)
        if key not in self._known:
            end_v = self.responses(stimulus)[1][0].end_v
            amplitude = np.linspace(0.0, end_v, _NODES)
            state = self.models[0].solve(touch[0], amplitude, *touch[1:])
            self._known[key] = ContactTable(
                amplitude,
                np.asarray(state.capacitance_f),
                np.asarray(state.conductance_s),
                np.asarray(state.pull_past_breakdown),
                float(state.x.max()),
            )
        table: ContactTable = self._known[key]
        return table

    def placeholders(self) -> list[str]:
        """Names of the placeholders that the predictions use."""
        return sorted({name for model in self.models for name in model.placeholders()})

    def profiles(self) -> dict[str, Any]:
        """Profiles of the screen and of all fingers, as plain values."""
        return {
            "screen": self.screen.model_dump(mode="json"),
            "fingers": [model.finger.model_dump(mode="json") for model in self.models],
        }

    def profile_hash(self) -> str:
        """Hash of `profiles`."""
        return self._profile_hash

    @cached_property
    def _profile_hash(self) -> str:
        return hashlib.sha256(json.dumps(self.profiles(), sort_keys=True).encode()).hexdigest()

    def surface_keys(self) -> list[str]:
        """Hashes of everything that decides the surfaces' numbers."""
        return [str(surface.info["key"]) for surface in self.surfaces]


def _ripple(stimulus: Stimulus, response_hz_per_mm_per_s: float) -> Array | None:
    """Attraction over its mean that the finger follows within a period; None with a carrier."""
    if stimulus.carrier_hz is not None or stimulus.drive_hz is None:
        return None
    share = 1.0
    if stimulus.speed is not None:
        t = np.linspace(0.0, stimulus.length_s, _PLACES)
        speed = np.abs(np.diff(stimulus.speed.position_mm(t))) / (t[1] - t[0])
        followed = FingerResponse(response_hz_per_mm_per_s).power(2 * stimulus.drive_hz, speed)
        share = float(np.mean(followed))
    attraction = DirectWave(stimulus.drive_hz).attraction
    assert attraction is not None  # a sine has a ripple
    return 1 + sqrt(share) * (attraction - 1)
