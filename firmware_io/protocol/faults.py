"""Faults: why a device refuses a frame or stops by itself, as codes and as sentences."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class FaultCode(IntEnum):
    """Why the device refused a frame, or stopped by itself."""

    NONE = 0
    DAMAGED = 1
    VERSION = 2
    KIND = 3
    LENGTH = 4
    SEQUENCE = 5
    SAMPLE_INDEX = 6
    NOT_ARMED = 7
    ALREADY_ARMED = 8
    NOT_SET_UP = 9
    SETUP = 10
    MODE = 11
    CEILING = 12
    SLEW = 13
    QUEUE_FULL = 14
    STARVED = 15
    TRUNCATED = 16
    ENERGY = 17
    MEAN = 18


@dataclass(frozen=True)
class FaultReport:
    """Device: it refused a frame, or ended the stream by itself.

    Parameters
    ----------
    code : FaultCode
        The first cause.
    field_offset : int
        For SETUP, the offset of the first impossible field in the payload; else 0.
    sequence : int
        Sequence of the refused frame; 0 if there is none.
    expected, got : int
        Their meaning for each code is in PROTOCOL.md.
    clock_ticks : int
        Time, by the device's clock.
    """

    code: FaultCode
    field_offset: int
    sequence: int
    expected: int
    got: int
    clock_ticks: int

    def __str__(self) -> str:
        return _SENTENCES[self.code].format(
            expected=self.expected,
            got=self.got,
            expected_v=self.expected / 1e3,
            got_v=self.got / 1e3,
            expected_s=self.expected / 1e3,
            field=_SETUP_FIELDS.get(self.field_offset, "payload"),
            name=_ONLY_DISARMED.get(self.got, "A frame"),
        )


_SETUP_FIELDS = {
    0: "mode",
    2: "watchdog_ms",
    4: "sample_rate_hz",
    8: "full_scale_mv",
    12: "ceiling_mv",
    16: "max_slew_v_per_s",
    20: "carrier_mhz",
    24: "lead_us",
    28: "status_ms",
}

#: Kinds of frames that are refused while armed.
_ONLY_DISARMED = {0x02: "SETUP", 0x03: "ARM"}

_SENTENCES = {
    FaultCode.NONE: "No fault.",
    FaultCode.DAMAGED: "A frame came damaged: a check sum of {expected:#x} was due, {got:#x} came.",
    FaultCode.VERSION: "The device speaks protocol version {expected}, but version {got} came.",
    FaultCode.KIND: "The device knows no frame of kind {got:#04x}.",
    FaultCode.LENGTH: "A payload of {expected} bytes was due, but {got} bytes came.",
    FaultCode.SEQUENCE: "Expected sequence {expected}, but {got} came.",
    FaultCode.SAMPLE_INDEX: "Expected sample index {expected}, but {got} came.",
    FaultCode.NOT_ARMED: "STREAM came while not armed.",
    FaultCode.ALREADY_ARMED: "{name} came while armed.",
    FaultCode.NOT_SET_UP: "ARM came before SETUP.",
    FaultCode.SETUP: "The set-up's {field} of {got} is refused, the bound is {expected}.",
    FaultCode.MODE: "Mode {expected} was due, but mode {got} came.",
    FaultCode.CEILING: "A sample of {got_v:g} V is above the ceiling of {expected_v:g} V.",
    FaultCode.SLEW: "Sample {got} of a frame breaks the slew limit of {expected} V/s.",
    FaultCode.QUEUE_FULL: "There was room for {expected} samples, but {got} came.",
    FaultCode.STARVED: (
        "The stream starved, no frame came within {expected_s:g} s; send samples earlier, with a "
        "longer lead or in longer blocks, and stop before a pause."
    ),
    FaultCode.TRUNCATED: "A frame broke off: {expected} bytes were due, but {got} came.",
    FaultCode.ENERGY: (
        "The rms voltage over a second would exceed {expected_v:g} V, with the time that a sample "
        "was held; lower the amplitude, or pause."
    ),
    FaultCode.MEAN: (
        "The mean voltage over a second would exceed {expected_v:g} V, with the time that a sample "
        "was held; remove the offset, send without pauses, and rest before trying again."
    ),
}
