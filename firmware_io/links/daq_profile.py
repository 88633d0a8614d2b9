"""The analog output of a card and the amplifier behind it, and what ends its drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from firmware_io.errors import DeviceError
from firmware_io.links.rig_profile import RigProfile

_HIGHEST_BUFFER_S = 0.5
_LEAST_STATEMENT = 8  # letters of an interlock


@dataclass(frozen=True, kw_only=True)
class DaqProfile(RigProfile):
    """The analog output and the amplifier behind it; `amplifier_gain` is needed.

    Parameters
    ----------
    channel : str
        The output, such as ``Dev1/ao0``.
    watchdog : str, optional
        What the card's watchdog takes to 0 when the host dies: ``yes`` for the output itself
        (chassis of CompactDAQ), or a digital line that enables the amplifier, such as
        ``Dev1/port0/line0`` (X Series, whose watchdog knows lines only).
    interlock : str, optional
        Otherwise what takes the voltage off the screen then, in words.
    trigger : str, optional
        A second output of the card, as a digital line: 5 V for 1 ms from the first sample of each
        playback and from each mark.
    monitor : str, optional
        An input of the card that reads the output back, such as ``Dev1/_ao0_vs_aognd``.
    buffer_s : float
        Samples that wait for the card's clock, in seconds.

    Raises
    ------
    DeviceError
        If nothing ends the drive when the host dies, or a value is missing or impossible.
    """

    device_name: ClassVar[str] = "analog output"

    channel: str = ""
    watchdog: str | None = None
    interlock: str | None = None
    trigger: str | None = None
    monitor: str | None = None
    buffer_s: float = 0.03
    dac_full_scale_v: float | None = 10.0
    sample_rate_hz: float = 50_000.0  # divides the timebase of 100 MHz

    def __post_init__(self) -> None:
        if not self.channel:
            raise DeviceError("daq: needs the analog output, as in channel=Dev1/ao0.")
        if self.amplifier_gain is None or self.dac_full_scale_v is None:
            raise DeviceError(
                "daq: needs amplifier_gain, in V/V: the card knows its own volts only."
            )
        if self.watchdog is not None and self.watchdog != "yes" and "/" not in self.watchdog:
            raise DeviceError(
                f"watchdog of daq: must be yes, or a digital line as Dev1/port0/line0, but is "
                f"{self.watchdog!r:.60}."
            )
        if not self.watchdog and len((self.interlock or "").strip()) < _LEAST_STATEMENT:
            raise DeviceError(
                "A card may hold its last voltage when its host dies: give watchdog=yes if the "
                "card has a watchdog for this output, watchdog= with the digital line that enables "
                "the amplifier, or say by interlock= in a few words what takes the voltage off "
                "the screen then."
            )
        if not 0.002 <= self.buffer_s <= _HIGHEST_BUFFER_S:
            raise DeviceError(
                f"buffer_s must be 0.002 to {_HIGHEST_BUFFER_S:g}, but is {self.buffer_s!r:.60}."
            )
        super().__post_init__()

    @property
    def screen_full_scale_v(self) -> float:
        """Volts on the screen at digital full scale: no more than the ceiling needs."""
        assert self.dac_full_scale_v is not None and self.amplifier_gain is not None
        return min(self.ceiling_v, self.dac_full_scale_v * self.amplifier_gain)

    @property
    def card_full_scale_v(self) -> float:
        """Volts of the card at digital full scale, beyond which it refuses samples itself."""
        assert self.amplifier_gain is not None
        return self.screen_full_scale_v / self.amplifier_gain

    @property
    def line_of_amplifier(self) -> str | None:
        """The digital line that enables the amplifier, as long as the watchdog is fed."""
        return None if self.watchdog == "yes" else self.watchdog

    @property
    def has_line(self) -> bool:
        """Whether a second output is its digital line."""
        return self.trigger is not None
