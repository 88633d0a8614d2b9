"""A stimulus: a signal, its quantity, and the touch that it is made for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, fields
from functools import cached_property
from math import inf
from re import ASCII, fullmatch
from typing import Any, Literal

import numpy as np

from haptix.base.checks import Positive, checked
from haptix.base.errors import InputError
from haptix.base.kinds import Kind
from haptix.feel.along_path import MaterialSignal, SpeedProfile, speed_from
from haptix.feel.materials import material_of
from haptix.feel.signals.signal import Signal, signal_from
from haptix.model.presets import DEFAULT_CARRIER_HZ

Quantity = Literal["mu", "contrast", "share", "volts"]


@checked()
class Stimulus:
    """A signal and the touch that it is made for.

    Parameters
    ----------
    name : str
        Names its files: letters, digits, ``-``, ``_`` and ``.``.
    signal : Signal
        Values against time.
    quantity : {"mu", "contrast", "share", "volts"}
        Quantity of the values: friction coefficients; the relative change from the friction without
        voltage; shares of the reachable friction; or volts.
    normal_force_n : float
        Normal force of the touch [N].
    carrier_hz : float or None
        Frequency of the carrier, whose amplitude follows the signal. With None, volts are played as
        they are.
    drive_hz : float, optional
        Without a carrier: the frequency at which skin and insulator are evaluated.
    speed : SpeedProfile, optional
        How the finger moves; by default the speed of the spatial signals within.
    h0_m : float, optional
        Effective thickness, where the surface spans several.
    conditions : mapping
        Columns of the trial table.
    """

    name: str
    signal: Signal
    quantity: Quantity = "contrast"
    normal_force_n: Positive = 0.5
    carrier_hz: Positive | None = DEFAULT_CARRIER_HZ
    drive_hz: Positive | None = None
    speed: SpeedProfile | None = None
    h0_m: Positive | None = None
    conditions: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not fullmatch(r"[\w-][\w.-]*", self.name, ASCII):
            raise InputError(f"name: expected letters, digits, '-', '_' and '.', got {self.name!r}")
        if self.quantity != "volts" and self.carrier_hz is None:
            raise InputError(
                "carrier_hz: friction needs a carrier whose amplitude follows it; give one, or "
                'make the stimulus in volts (quantity = "volts")'
            )
        if self.carrier_hz is not None and self.drive_hz is not None:
            raise InputError("drive_hz: a carrier has its own frequency; leave it out")
        for part in self.signal.walk():
            if isinstance(part, MaterialSignal):
                self._check(part)
        speeds = {part for part in self.signal.walk() if isinstance(part, SpeedProfile)}
        if self.speed is None and len(speeds) == 1:
            object.__setattr__(self, "speed", speeds.pop())
        elif speeds - {self.speed}:
            raise InputError(
                f"{self.name}: speed: its parts are made for different speeds; give "
                "one speed to all of them"
            )
        if self.signal.length_s == inf:
            raise InputError(
                f"{self.name}: the signal has no end; give it one with .lasting(seconds)"
            )

    def _check(self, part: MaterialSignal) -> None:
        if part.target != self.quantity:
            raise InputError(
                f'quantity: the material is in {part.target}; give quantity = "{part.target}", or '
                "a target to the material"
            )
        if part.normal_force_n != self.normal_force_n:
            raise InputError(
                f"normal_force_n: expected that of the material, {part.normal_force_n:g} N, got "
                f"{self.normal_force_n:g} N"
            )

    @property
    def length_s(self) -> float:
        """Length [s]."""
        return self.signal.length_s

    @property
    def frequency_hz(self) -> float | None:
        """Frequency at which skin and insulator are evaluated."""
        return self.drive_hz if self.carrier_hz is None else self.carrier_hz

    def describe(self) -> dict[str, Any]:
        """Return everything that determines the stimulus, as plain values."""
        return dict(self._described)

    @cached_property
    def _described(self) -> dict[str, Any]:
        table = {field.name: getattr(self, field.name) for field in fields(self)}
        for name, value in table.items():
            if isinstance(value, Kind):
                table[name] = value.describe()
            elif isinstance(value, np.generic):
                table[name] = value.item()
        return table | {"conditions": dict(self.conditions)}


_IN_SPACE = ("along-path", "grating", "relief")


def stimulus_from(name: str, table: Mapping[str, Any]) -> Stimulus:
    """Read a stimulus from a table; a speed given here applies to the spatial signals within.

    A table with a ``drive_hz`` and no ``carrier_hz`` has no carrier. The force is also that of the
    materials within, and without a quantity the stimulus has theirs. Raises `InputError` if a field
    is unknown, missing or wrong.
    """
    known = {field.name for field in fields(Stimulus)} - {"name"} | {"length_s"}
    unknown = sorted(set(table) - known)
    if unknown:
        raise InputError(
            f"{name}.{unknown[0]}: unknown; expected any of {', '.join(sorted(known))}"
        )
    if "signal" not in table:
        raise InputError(f"{name}.signal: missing; a stimulus needs one")
    values = dict(table)
    if "drive_hz" in values:
        values.setdefault("carrier_hz", None)  # played as it is
    shared = ("speed", "normal_force_n")
    try:
        if values.get("speed") is not None:
            values["speed"] = speed_from(values["speed"])
        of_all = {key: values[key] for key in shared if values.get(key) is not None}
        signal = signal_from(_with_shared(values["signal"], of_all))
        targets = [part.target for part in signal.walk() if isinstance(part, MaterialSignal)]
        if targets:
            values.setdefault("quantity", targets[0])
        values["signal"] = (
            signal.lasting(values.pop("length_s")) if "length_s" in values else signal
        )
        return Stimulus(name, **values)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def _with_shared(table: Any, shared: Mapping[str, Any]) -> Any:
    """Give the finger's speed, and to materials its force, to signals in space without."""
    if isinstance(table, list | tuple):
        return [_with_shared(item, shared) for item in table]
    if not isinstance(table, Mapping):
        return table
    kind = str(table.get("kind"))
    if kind == "material":
        # Kinds of materials and of signals have some names in common: these are not looked into.
        of = {"of": material_of(table["of"])} if "of" in table else {}
        return {**shared, **table, **of}
    inner = {key: _with_shared(value, shared) for key, value in table.items()}
    if kind in _IN_SPACE and "speed" in shared:
        inner.setdefault("speed", shared["speed"])
    return inner
