"""The log of what happens between a touch and the driver, in which faults are looked for.

Each package logs by Python's `logging` under its name, such as ``haptix.play.render``: at ``info``
every change of state and all that is refused, repeated or dropped, with the reason; at ``debug``
also every frame. `start` writes these records in a thread of its own, so a caller never waits:
records that a slow or full disk does not take are dropped and counted, and the log notes where they
are missing. It must never hold a secret or a participant's answers.
"""

from __future__ import annotations

import atexit
import logging
import os
import re
import sys
import warnings
from contextlib import suppress
from datetime import datetime
from logging.handlers import QueueHandler, QueueListener, RotatingFileHandler
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TextIO

from filelock import FileLock, Timeout

from haptix.base.errors import InputError

VARIABLE = "HAPTIX_LOG"
"""The environment's ``LEVEL`` or ``LEVEL,FILE``; the processes that this one starts read it too."""

ROOMS = ("haptix", "firmware_io", "calibration")
LEVELS = ("info", "debug")
MOST_WAITING = 8192
FILE_BYTES, FILES_BEFORE = 20_000_000, 4
END_S = 2.0  # time for the disk to take the waiting records when the process ends
_SECRETS = re.compile(r"(?i)\b((?:token|password|secret|key)(?:=|['\"]: ?['\"]))[^\s,&'\"]+")
_CREDENTIALS = re.compile(r"://[^/\s]+@")

# Characters that move a terminal's cursor, except line breaks.
_CONTROL = {code: f"\\x{code:02x}" for code in (*range(10), *range(11, 32), 127)}

_running: Log | None = None


def start(level: str = "debug", file: str | Path | None = None) -> None:
    """Log from now on, here and in the processes that this one starts.

    Raises `InputError` if there is no such level, or the file cannot be written.

    Parameters
    ----------
    level : str
        "info" for changes of state, refusals, retries and losses; "debug" for all frames too.
    file : str or Path, optional
        The file; by default the standard error. At 20 MB it is renamed to ``FILE.1``, and four
        such files are kept. If another process logs to it, its name gets a number.
    """
    global _running
    if level not in LEVELS:
        raise InputError(f"log: expected {' or '.join(LEVELS)}, got {level!r}")
    stop()
    if file is None:
        _running = Log(level, LogOutput(sys.stderr))
        os.environ[VARIABLE] = level
    else:
        path = Path(file).absolute()
        _running = Log(level, _unused_file(path))
        os.environ[VARIABLE] = f"{level},{path}"


def into(file: Path) -> None:
    """Log to a file: at the level of the running log; if none runs, with all frames."""
    start(os.environ.get(VARIABLE, "").partition(",")[0] or "debug", file)


def start_as_environment_says() -> None:
    """Log if `VARIABLE` is set; a wrong value does not stop the program."""
    level, _, file = os.environ.get(VARIABLE, "").partition(",")
    if level:
        try:
            start(level, file or None)
        except InputError as error:
            warnings.warn(f"{VARIABLE}: {error}", stacklevel=2)


def stop() -> None:
    """Write waiting records, for two seconds at most, and end the log. Idempotent."""
    global _running
    log, _running = _running, None
    if log is not None:
        os.environ.pop(VARIABLE, None)
        log.close()


class Log:
    """Takes the records of all packages and writes them from a thread of its own.

    Parameters
    ----------
    level : str
        The lowest level that is taken.
    output : LogOutput
        Where they are written.
    """

    def __init__(self, level: str, output: LogOutput) -> None:
        self.queuer = _Queuer(SimpleQueue())
        self.writer = _Writer(self.queuer, output)
        self.writer.start()
        for package in ROOMS:
            logging.getLogger(package).addHandler(self.queuer)
            logging.getLogger(package).setLevel(level.upper())
        # Name the module or the file only: the other arguments may be secret.
        by_module = sys.orig_argv[1:2] == ["-m"]
        program = sys.orig_argv[2] if by_module else Path(sys.argv[0]).name
        logging.getLogger("haptix.base.log").info("%s begins", program)
        atexit.register(self.close)

    def close(self) -> None:
        """Write waiting records; print to standard error how many could not be written."""
        atexit.unregister(self.close)
        for room in ROOMS:
            logging.getLogger(room).removeHandler(self.queuer)
            logging.getLogger(room).setLevel(logging.NOTSET)
        missing = self.writer.end()
        if missing:
            why = self.writer.output.why or "it is written slower than it comes"
            sys.stderr.write(f"haptix: the end of the log lacks {missing} records: {why}\n")


class _Queuer(QueueHandler):
    """Queues records for the writer. Nothing here waits, neither for a lock nor for space."""

    queue: SimpleQueue[Any]
    dropped = 0

    def handle(self, record: logging.LogRecord) -> bool:
        self.emit(record)  # without the handler's lock, which a thread without priority may hold
        return True

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        return record  # the writer makes the text

    def enqueue(self, record: logging.LogRecord) -> None:
        if self.queue.qsize() < MOST_WAITING:
            record.dropped_before = self.dropped
            self.queue.put(record)
        else:
            self.dropped += 1


class _Writer(QueueListener):
    """Writes records; where some are missing, it writes how many."""

    def __init__(self, queuer: _Queuer, output: LogOutput) -> None:
        super().__init__(queuer.queue)
        self.output = output
        self._queuer, self._reported = queuer, 0

    def handle(self, record: logging.LogRecord) -> None:
        self._tell(record.dropped_before)  # type: ignore[attr-defined]  # of _Queuer
        self.output.handle(record)

    def end(self) -> int:
        """Write waiting records; return the number of lost records that no line counts yet."""
        thread = self._thread
        assert thread is not None
        self.enqueue_sentinel()
        thread.join(END_S)
        waiting = 0
        if thread.is_alive():  # the disk takes none; the thread ends with the process
            waiting = self._queuer.queue.qsize()
        else:
            self._tell(self._queuer.dropped)
            self.output.close()
        return self._queuer.dropped + self.output.lost - self._reported + waiting

    def _tell(self, dropped: int) -> None:
        lost = self.output.lost
        missing = dropped + lost - self._reported
        if missing:
            why = self.output.why or "written slower than it came"
            text = f"{missing} records are missing here: {why}"
            self.output.handle(logging.makeLogRecord(
                {"name": "haptix.base.log", "levelname": "INFO", "msg": text}
            ))  # fmt: skip
            if self.output.lost == lost:
                self._reported, self.output.why = self._reported + missing, ""
            self.output.lost = lost


class LogOutput(logging.StreamHandler[TextIO]):
    """Where records are written. Failures are counted, and never raised or printed."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.lost, self.why = 0, ""
        self.setFormatter(_Lines("%(asctime)s %(process)d %(name)s %(levelname)s %(message)s"))

    def handleError(self, record: logging.LogRecord) -> None:
        """Count it, and keep why."""
        self.lost += 1
        self.why = str(sys.exc_info()[1])


class _File(LogOutput, RotatingFileHandler):
    """A file of this user alone, which is begun anew when it is full."""

    def __init__(self, path: Path, lock: FileLock | None) -> None:
        self._lock = lock
        super().__init__(path, maxBytes=FILE_BYTES, backupCount=FILES_BEFORE, encoding="utf-8")

    def _open(self) -> Any:
        return open(
            self.baseFilename, "a", encoding="utf-8",
            opener=lambda path, flags: os.open(path, flags, 0o600),
        )  # fmt: skip

    def handleError(self, record: logging.LogRecord) -> None:
        super().handleError(record)
        # The stream would try its unwritten text again with each record: begin a new one.
        stream, self.stream = self.stream, None  # emit opens it again
        if stream is not None:
            with suppress(OSError):
                stream.close()

    def close(self) -> None:
        super().close()
        if self._lock is not None:
            self._lock.release()


class _Lines(logging.Formatter):
    """One line a record, with microseconds; further lines are indented, and secrets left out."""

    def formatTime(self, record: logging.LogRecord, datefmt: str | None = None) -> str:
        return datetime.fromtimestamp(record.created).isoformat(timespec="microseconds")

    def format(self, record: logging.LogRecord) -> str:
        text = super().format(record).translate(_CONTROL).replace("\n", "\n    ")
        return without_secrets(text)


def without_secrets(text: str) -> str:
    """Return a text, such as an address, with *** in place of tokens and passwords."""
    return _CREDENTIALS.sub("://***@", _SECRETS.sub(r"\1***", text))


def _unused_file(path: Path) -> _File:
    """Return the file, or the first of ``NAME-2.log``, ``NAME-3.log``, ... that is not in use."""
    number = 1
    while True:
        candidate = path if number == 1 else path.with_stem(f"{path.stem}-{number}")
        try:
            if candidate.exists() and not candidate.is_file():  # a pipe, or /dev/null
                return _File(candidate, None)
            lock = FileLock(candidate.with_name(f".{candidate.name}.lock"), timeout=0)
            lock.acquire()
            return _File(candidate, lock)
        except Timeout:
            number += 1
        except OSError as error:
            raise InputError(f"log: cannot write {candidate}: {error.strerror or error}") from None
