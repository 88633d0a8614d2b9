"""A session on disk: one folder for one finger on one screen, and the instruments in use.

::

    protocol.toml            which strokes to make
    session.json             screen, finger, operator; written last
    instruments.toml         instruments with the dates of their certificates
    strokes/stroke-007.h5    accepted strokes, one file each, whole or absent
    rejected/stroke-007-1.h5 rejected ones, with the reasons inside
    reduced.csv, fit.json, screen.toml, report.html, archive.zip   results of the later steps
    finished.json            the result of a run, so that the same run computes nothing again
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import date
from hashlib import sha256
from itertools import count
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from calibration.measure.recording import StrokeRecording
from calibration.plan.protocol import Protocol, Stroke
from haptix.base.documents import Document, Part
from haptix.base.errors import FileFormatError, InputError
from haptix.base.report import Heading
from haptix.model.finger import Finger
from haptix.model.screen import Screen


class SessionInfo(Document):
    """Screen, finger and person of a session.

    Parameters
    ----------
    screen, finger : Screen, Finger
        The assumed ones, from which the fit starts. The screen has a name of its own.
    operator : str
        Name of the person who measures.
    crosstalk : float
        Share of the normal force that the tangential axis shows, from the sensor's certificate.
    """

    screen: Screen
    finger: Finger
    operator: str = ""
    crosstalk: float = 0.0


@dataclass(frozen=True)
class Session:
    """A folder, its protocol and its strokes.

    Parameters
    ----------
    folder : Path
        Where the session lies.
    protocol : Protocol
        Its strokes.
    info : SessionInfo
        Screen, finger and operator.
    """

    folder: Path
    protocol: Protocol
    info: SessionInfo

    @classmethod
    def begin(
        cls, folder: str | Path, protocol: Protocol, info: SessionInfo, resume: bool = False
    ) -> Session:
        """Make the folder, or continue the session that is in it.

        Parameters
        ----------
        folder : str or Path
            Where the session lies.
        protocol : Protocol
            Its strokes.
        info : SessionInfo
            Screen, finger and operator.
        resume : bool
            Whether a session that is there may go on.

        Raises
        ------
        InputError
            If the folder has a session and `resume` is False, or one of another protocol, screen or
            finger.
        FileFormatError
            If the folder cannot be written.
        """
        folder = Path(folder)
        if not cls.has_begun(folder):
            protocol.save(folder / "protocol.toml")
            info.save(folder / "session.json")
            return cls(folder, protocol, info)
        if not resume:
            raise InputError(
                f"{folder} has a session: continue it with --resume, or choose another folder; "
                "nothing that was measured is overwritten"
            )
        existing = cls.open(folder)
        if existing.protocol != protocol:
            raise InputError(
                f"{folder} was measured by another protocol ({existing.protocol.name}, "
                f"{len(existing.protocol.strokes)} strokes); resume with that one"
            )
        for what in ("screen", "finger"):
            before, now = getattr(existing.info, what), getattr(info, what)
            if before != now:
                raise InputError(
                    f"{folder} is a session of the {what} {before.name!r}, got "
                    + (repr(now.name) if now.name != before.name else "one with other numbers")
                    + "; resume with that one, or choose another folder"
                )
        return existing

    @staticmethod
    def has_begun(folder: Path) -> bool:
        """Whether both files of a session are there; one that was stopped between them has none."""
        return all((folder / name).exists() for name in ("protocol.toml", "session.json"))

    @classmethod
    def open(cls, folder: str | Path) -> Session:
        """Read a session's folder.

        Raises
        ------
        FileFormatError, InputError
            If it holds no session, or a damaged one.
        """
        folder = Path(folder)
        path = folder / "session.json"
        if not path.exists():
            raise FileFormatError(
                f"{folder} is no session (it has no {path.name}); measure first, with "
                "`haptix calibrate measure`"
            )
        return cls(folder, Protocol.load(folder / "protocol.toml"), SessionInfo.load(path))

    def path_of(self, stroke: Stroke) -> Path:
        """File of an accepted stroke."""
        return self.folder / "strokes" / f"stroke-{stroke.number:03d}.h5"

    @property
    def open_strokes(self) -> tuple[Stroke, ...]:
        """Strokes that are still to be made, in order."""
        return tuple(
            stroke for stroke in self.protocol.strokes if not self.path_of(stroke).exists()
        )

    @property
    def recordings(self) -> list[StrokeRecording]:
        """All accepted strokes on disk.

        Raises
        ------
        FileFormatError
            If a file is no recording, or one of another stroke than its name and the plan say.
        """
        recordings = []
        for stroke in self.protocol.strokes:
            path = self.path_of(stroke)
            if not path.exists():
                continue
            recording = StrokeRecording.load(path)
            if recording.stroke != stroke:
                raise FileFormatError(
                    f"{path}: expected {stroke.label}, got {recording.stroke.label}: it was copied "
                    "here, or the protocol was changed; measure it again"
                )
            recordings.append(recording)
        return recordings

    def hashes(self, *results: str) -> dict[str, str]:
        """SHA-256 of the plan, of who and what, of the strokes, and of further files."""
        strokes = [self.path_of(stroke) for stroke in self.protocol.strokes]
        named = [self.folder / name for name in ("protocol.toml", "session.json", *results)]
        return {
            path.relative_to(self.folder).as_posix(): sha256(path.read_bytes()).hexdigest()
            for path in (*named, *strokes)
            if path.exists()
        }

    def keep(self, recording: StrokeRecording) -> Path:
        """Write a recording among the strokes, or with findings among the rejected ones."""
        path = self.path_of(recording.stroke)
        if recording.findings:
            path = self._free_rejected(path)
        recording.save(path)
        return path

    def open_again(self, stroke: Stroke) -> None:
        """Put an accepted stroke among the rejected ones: it is to be made once more."""
        path = self._free_rejected(self.path_of(stroke))
        path.parent.mkdir(exist_ok=True)
        self.path_of(stroke).rename(path)

    def _free_rejected(self, path: Path) -> Path:
        attempts = (self.folder / "rejected" / f"{path.stem}-{attempt}.h5" for attempt in count(1))
        return next(attempt for attempt in attempts if not attempt.exists())


INSTRUMENTS = "instruments.toml"
"""Name of the file in a session's folder."""

DRIVER = "driver"
"""Instrument that needs no certificate: the rig's check reads its volts."""

Word = Annotated[str, Field(min_length=1)]


class Instrument(Part):
    """One instrument."""

    name: Annotated[Word, Heading("instrument")]
    serial: Annotated[Word, Heading("serial number")]
    """As recordings name it, such as "force sensor" and "FT12345"."""
    certificate: Annotated[Word, Heading("certificate")]
    """Number of its certificate."""
    calibrated_on: Annotated[date, Heading("calibrated on")]
    due_on: Annotated[date, Heading("due on")]
    """First and last day on which the certificate holds."""

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
    """All instruments of a rig, as a file; one whose certificate has expired is refused."""

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
            missing = f'no instrument of the file has name = "{name}" and serial = "{serial}"'
            faults.append(missing if instrument is None else instrument.fault(day))
        return [fault for fault in faults if fault]

    def check_strokes(self, recordings: Iterable[StrokeRecording]) -> None:
        """Raise `InputError` unless all were valid on the day of each stroke; strokes are kept."""
        late: dict[str, list[int]] = {}
        for recording in recordings:
            day = date.fromisoformat(recording.conditions.started[:10])
            for fault in self.faults(recording.conditions.instruments, day):
                late.setdefault(fault, []).append(recording.stroke.number)
        if late:
            reasons = (f"{why} (strokes {', '.join(map(str, at))})" for why, at in late.items())
            raise InputError(
                f"{'; '.join(reasons)}: the strokes are kept; calibrate the instrument, and open "
                "these strokes again"
            )
