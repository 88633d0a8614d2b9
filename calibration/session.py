"""A session on disk: one folder for one finger on one screen, stroke by stroke.

::

    protocol.toml            what is to be done
    session.json             screen, finger, operator
    strokes/stroke-007.h5    what was accepted, one file each, whole or not there
    rejected/stroke-007-1.h5 what was not, with the reasons inside
    reduced.csv, fit.json, screen.toml, report.html, archive.zip   what the later steps make
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calibration.protocol import Protocol, Stroke
from calibration.recording import StrokeRecording
from haptix.documents import Document
from haptix.errors import FileFormatError, InputError
from haptix.finger import Finger
from haptix.screen import Screen


class SessionInfo(Document):
    """Who and what, once for a session.

    Parameters
    ----------
    screen, finger : Screen, Finger
        As they are believed to be: where the fit starts. The screen has a name of its own.
    operator : str
        Who measures.
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
        Where everything lies.
    protocol : Protocol
        What is to be done.
    info : SessionInfo
        Who and what.
    """

    folder: Path
    protocol: Protocol
    info: SessionInfo

    @classmethod
    def begin(
        cls, folder: str | Path, protocol: Protocol, info: SessionInfo, resume: bool = False
    ) -> Session:
        """Make the folder, or take up what is in it.

        Raises
        ------
        InputError
            If the folder has a session and `resume` is False, or one of another protocol.
        FileFormatError
            If the folder cannot be written.
        """
        folder = Path(folder)
        if (folder / "protocol.toml").exists():
            if not resume:
                raise InputError(
                    f"{folder} has a session: go on with --resume, or choose another folder; "
                    "nothing that was measured is overwritten"
                )
            there = cls.open(folder)
            if there.protocol != protocol:
                raise InputError(
                    f"{folder} was measured by another protocol ({there.protocol.name}, "
                    f"{len(there.protocol.strokes)} strokes); resume with that one"
                )
            return there
        info.save(folder / "session.json")
        protocol.save(folder / "protocol.toml")
        return cls(folder, protocol, info)

    @classmethod
    def open(cls, folder: str | Path) -> Session:
        """Read a session's folder.

        Raises
        ------
        FileFormatError
            If it is none.
        """
        folder = Path(folder)
        path = folder / "session.json"
        if not path.is_file():
            raise FileFormatError(
                f"{folder} is no session (it has no {path.name}); measure first, with "
                "`haptix calibrate measure`"
            )
        info = SessionInfo.load(path)
        return cls(folder, Protocol.load(folder / "protocol.toml"), info)

    def path_of(self, stroke: Stroke) -> Path:
        """File of an accepted stroke."""
        return self.folder / "strokes" / f"stroke-{stroke.number:03d}.h5"

    @property
    def open_strokes(self) -> tuple[Stroke, ...]:
        """Strokes that are still to be made, in order."""
        return tuple(one for one in self.protocol.strokes if not self.path_of(one).exists())

    @property
    def recordings(self) -> list[StrokeRecording]:
        """All accepted strokes on disk."""
        return [
            StrokeRecording.load(self.path_of(one))
            for one in self.protocol.strokes
            if self.path_of(one).exists()
        ]

    def keep(self, recording: StrokeRecording) -> Path:
        """Write a recording: among the strokes, or where it has complaints among the rejected."""
        if not recording.complaints:
            path = self.path_of(recording.stroke)
        else:
            attempt = 1
            while True:
                name = f"stroke-{recording.stroke.number:03d}-{attempt}.h5"
                path = self.folder / "rejected" / name
                if not path.exists():
                    break
                attempt += 1
        recording.save(path)
        return path
