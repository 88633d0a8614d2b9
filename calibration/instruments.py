"""Instruments of a rig with the dates of their certificates: an expired one is refused."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import date
from typing import Annotated, Self

from pydantic import Field, model_validator

from calibration.recording import StrokeRecording
from haptix.documents import Document, Part
from haptix.errors import InputError
from haptix.report import Heading

INSTRUMENTS = "instruments.toml"
"""Name of the file in a session's folder."""

DRIVER = "driver"
"""Instrument that needs no certificate: the rig's check reads its volts."""

Word = Annotated[str, Field(min_length=1)]


class Instrument(Part):
    """One instrument.

    Parameters
    ----------
    name, serial : str
        As recordings name it, such as "force sensor" and "FT12345".
    certificate : str
        Number of its certificate.
    calibrated_on, due_on : datetime.date
        First and last day on which the certificate holds.
    """

    name: Annotated[Word, Heading("instrument")]
    serial: Annotated[Word, Heading("serial number")]
    certificate: Annotated[Word, Heading("certificate")]
    calibrated_on: Annotated[date, Heading("calibrated on")]
    due_on: Annotated[date, Heading("due on")]

    @model_validator(mode="after")
    def _is_in_order(self) -> Self:
        if self.due_on < self.calibrated_on:
            raise ValueError(f"{self.name}: expected a due date after {self.calibrated_on}")
        return self

    def fault(self, day: date) -> str:
        """Return why its certificate is not valid on a day; empty if it is."""
        which = f"{self.name} {self.serial}"
        if day > self.due_on:
            return f"{which}: its certificate {self.certificate} expired on {self.due_on}"
        if day < self.calibrated_on:
            return (
                f"{which}: its certificate {self.certificate} begins on {self.calibrated_on}, "
                f"after {day}; was a clock set back?"
            )
        return ""


class Instruments(Document):
    """All instruments of a rig, as a file."""

    instruments: Annotated[tuple[Instrument, ...], Field(min_length=1)]

    def check(self, used: Mapping[str, str], day: date) -> None:
        """Raise `InputError` unless all used instruments have a certificate valid on a day.

        `used` has serial numbers by names, as a source of forces or a recording has them.
        """
        if faults := self.faults(used, day):
            raise InputError(
                "; ".join(faults) + ": calibrate it, and put its new dates in the file"
            )

    def faults(self, used: Mapping[str, str], day: date) -> list[str]:
        """Return which of the used instruments have no valid certificate on a day."""
        known = {(each.name, each.serial): each for each in self.instruments}
        faults = []
        for name, serial in used.items():
            if name == DRIVER:
                continue
            instrument = known.get((name, serial))
            said = f"{name} {serial}: it is not in the file of instruments"
            faults.append(said if instrument is None else instrument.fault(day))
        return [fault for fault in faults if fault]

    def check_strokes(self, recordings: Iterable[StrokeRecording]) -> None:
        """Raise `InputError` unless all were valid on the day of each stroke; strokes are kept."""
        late: dict[str, list[int]] = {}
        for recording in recordings:
            day = date.fromisoformat(recording.conditions.started[:10])
            for fault in self.faults(recording.conditions.instruments, day):
                late.setdefault(fault, []).append(recording.stroke.number)
        if late:
            said = (f"{why} (strokes {', '.join(map(str, at))})" for why, at in late.items())
            raise InputError(
                f"{'; '.join(said)}: what was measured is kept; calibrate the instrument, and open "
                "these strokes again"
            )
