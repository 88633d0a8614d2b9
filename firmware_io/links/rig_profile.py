"""What stands behind an output that does not know its volts: a converter and an amplifier."""

from __future__ import annotations

import math
import tomllib
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

from firmware_io.errors import DeviceError
from firmware_io.limits import ABSOLUTE_CEILING_V, DEFAULT_MAX_SLEW_V_PER_S, WATCHDOG_S
from firmware_io.protocol import VERSION, CapabilitiesReport, Rate, StreamMode

_LARGEST_FILE = 10_000  # bytes of a profile, which has some hundreds
_LOWEST_V, _HIGHEST_V = 1e-3, 1e6  # beyond these a number is no amplifier's
_HIGHEST_RATE_HZ = 1_000_000  # above those of all interfaces
_QUEUE_S = 0.5


@dataclass(frozen=True, kw_only=True)
class RigProfile(ABC):
    """An output and the amplifier behind it.

    Parameters
    ----------
    dac_full_scale_v : float, optional
        Peak volts at the output of the converter at digital full scale.
    amplifier_gain : float, optional
        Gain of the amplifier, in V/V.
    ceiling_v : float
        Largest voltage that amplifier and screen stand.
    sample_rate_hz : float
        A rate of the converter.

    Raises
    ------
    DeviceError
        If a number is impossible.
    """

    device_name: ClassVar[str]

    dac_full_scale_v: float | None = None
    amplifier_gain: float | None = None
    ceiling_v: float = ABSOLUTE_CEILING_V
    sample_rate_hz: float = 48_000.0

    @property
    @abstractmethod
    def screen_full_scale_v(self) -> float:
        """Volts on the screen at digital full scale."""

    @property
    @abstractmethod
    def has_line(self) -> bool:
        """Whether a second channel is its digital line."""

    def __post_init__(self) -> None:
        for name in ("full_scale_v", "dac_full_scale_v", "amplifier_gain", "ceiling_v"):
            value = getattr(self, name, None)
            if value is not None and not 0 < value <= _HIGHEST_V:
                raise DeviceError(
                    f"{name} must be a number above 0 and at most {_HIGHEST_V:g}, but is "
                    f"{value!r:.60}."
                )
        if not 8000 <= self.sample_rate_hz <= _HIGHEST_RATE_HZ:
            raise DeviceError(
                f"sample_rate_hz must be 8000 to {_HIGHEST_RATE_HZ}, but is "
                f"{self.sample_rate_hz!r:.60}."
            )
        if not _LOWEST_V <= self.screen_full_scale_v <= _HIGHEST_V:
            raise DeviceError(
                f"The full scale must lie in {_LOWEST_V:g}..{_HIGHEST_V:g} V, but is "
                f"{self.screen_full_scale_v:g} V."
            )

    def capabilities(self) -> CapabilitiesReport:
        """Return the capabilities of the firmware in front of the output."""
        rate = round(self.sample_rate_hz)
        slow = next(rate // n for n in range(math.ceil(rate / 16e3), rate) if rate % n == 0)
        full_scale_mv = round(self.screen_full_scale_v * 1e3)
        modes = frozenset((StreamMode.WAVEFORM, StreamMode.ENVELOPE))
        rates = [Rate(rate, modes)]
        if slow != rate:
            rates.append(Rate(slow, frozenset((StreamMode.ENVELOPE,))))
        return CapabilitiesReport(
            oldest_version=VERSION,
            newest_version=VERSION,
            report_bytes=0,
            output_rate_hz=rate,
            full_scale_mv=full_scale_mv,
            ceiling_mv=min(round(self.ceiling_v * 1e3), full_scale_mv),
            max_slew_v_per_s=math.floor(DEFAULT_MAX_SLEW_V_PER_S),
            queue_samples=round(_QUEUE_S * rate),
            max_frame_samples=1024,
            max_watchdog_ms=round(WATCHDOG_S * 1e3),
            name=self.device_name,
            serial="",
            calibration_id="",
            reports_touch=False,
            rates=tuple(rates),
            takes_marks=self.has_line,
        )


def read_rig_profile(path: str | Path, kind: type[RigProfile]) -> dict[str, Any]:
    """Return the entries of a TOML file with some or all of the keys of a profile.

    Raises
    ------
    DeviceError
        If the file cannot be read or understood.
    """
    try:
        with Path(path).open("rb") as file:
            text = file.read(_LARGEST_FILE + 1)
        if len(text) > _LARGEST_FILE:
            raise ValueError(f"expected at most {_LARGEST_FILE} bytes")
        entries = tomllib.loads(text.decode())
    except (OSError, RecursionError, ValueError) as error:
        raise DeviceError(f"The profile {path} cannot be read: {error}") from error
    types = {field.name: str(field.type) for field in fields(kind)}
    for key, value in entries.items():
        if key not in types:
            known = ", ".join(types)
            raise DeviceError(f"The profile {path} has {key!r:.60}; the keys are {known}.")
        if isinstance(value, int) and value.bit_length() > 64:
            raise DeviceError(f"{key} in the profile {path} has more than 64 bits.")
        if not isinstance(value, _KINDS[types[key]]) or (
            isinstance(value, bool) and types[key] != "bool"
        ):
            raise DeviceError(f"{key} in the profile {path} cannot be {value!r:.60}; correct it.")
    return entries


#: By the annotation of a field, of which this module's future import makes a text.
_KINDS: dict[str, tuple[type, ...]] = {
    "bool": (bool,),
    "str": (str,),
    "str | None": (str,),
    "str | int | None": (str, int),
    "float": (int, float),
    "float | None": (int, float),
}
