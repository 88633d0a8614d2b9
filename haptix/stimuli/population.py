"""Populations of fingers: drawn around one, or listed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from haptix.checks import positive
from haptix.errors import InputError
from haptix.finger import Finger


@dataclass(frozen=True)
class Population:
    """Fingers, and how they were drawn.

    Parameters
    ----------
    fingers : tuple of Finger
        All of them.
    statement : str
        The spread and its origin, for sidecars.
    """

    fingers: tuple[Finger, ...]
    statement: str

    def __post_init__(self) -> None:
        if not self.fingers:
            raise InputError("fingers: expected one or more")

    @classmethod
    def around(
        cls, finger: Finger, size: int, spread: Mapping[str, float], seed: int
    ) -> Population:
        """Draw fingers whose fields vary by equal ratios (log-normally), independently.

        Parameters
        ----------
        finger : Finger
            The median of every field.
        size : int
            How many, 2 or more.
        spread : mapping
            Standard deviation of the logarithm, by field: ``{"youngs_modulus_pa": 0.3,
            "roughness.h_rms_m": 0.1}``. There is no default.
        seed : int
            Decides the draw.
        """
        if type(size) is not int or size < 2:
            raise InputError(f"size: expected a whole number of 2 or more, got {size!r}")
        if not spread:
            raise InputError("spread: expected the spread of one field of the finger or more")
        for name, value in spread.items():
            positive(f"spread.{name}", value)
            _get(finger, name)
        draw = np.random.default_rng(seed).standard_normal((size, len(spread)))
        fingers = []
        for row in draw:
            one = finger
            for (name, width), z in zip(sorted(spread.items()), row, strict=True):
                one = _scaled(one, name, float(np.exp(width * z)))
            fingers.append(one)
        widths = ", ".join(f"{name} {width:g}" for name, width in sorted(spread.items()))
        return cls(
            tuple(fingers),
            f"{size} fingers around {finger.name!r}, log-normal with standard deviations of the "
            f"logarithm {widths}; seed {seed}",
        )


def _get(finger: Finger, name: str) -> float:
    value: Any = finger
    for part in name.split("."):
        value = getattr(value, part, None)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"spread.{name}: {finger.name!r} has no such number")
    return float(value)


def _scaled(finger: Finger, name: str, ratio: float) -> Finger:
    value = _get(finger, name) * ratio
    if "." not in name:
        return finger.replace(**{name: value})
    part, field = name.split(".", 1)
    inner = getattr(finger, part)
    return finger.replace(**{part: {**inner.model_dump(), field: value}})
