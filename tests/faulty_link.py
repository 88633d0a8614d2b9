"""A link to the mock on which faults happen: bytes lost, damaged, late, a cable unplugged."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum

from firmware_io import DeviceDisconnectedError, MockDriver, MockLink
from firmware_io.protocol import to_reports


class InjectedFault(StrEnum):
    """A fault of one transfer (a write, or one HID report)."""

    LOSE = "lose"  # it never arrives, without an error
    CORRUPT = "corrupt"  # one bit arrives wrong
    CUT = "cut"  # its second half never arrives, without an error: a short packet
    SHORT_WRITE = "short-write"  # its second half never arrives, and the write fails
    REPEAT = "repeat"  # it arrives twice
    DELAY = "delay"  # it arrives with the next one
    NOISE = "noise"  # bytes that are not a frame arrive before it
    STALL = "stall"  # time passes before it arrives
    TIME_OUT = "time-out"  # it never arrives, and the write fails
    DISCONNECT = "disconnect"  # the cable is unplugged before it and stays so
    LOSE_ANSWER = "lose-answer"  # an answer never arrives
    CORRUPT_ANSWER = "corrupt-answer"  # one bit of an answer arrives wrong
    MUTE = "mute"  # no more answers arrive


_OF_ANSWERS = (InjectedFault.LOSE_ANSWER, InjectedFault.CORRUPT_ANSWER, InjectedFault.MUTE)


@dataclass
class _Due:
    fault: InjectedFault
    transfers_left: int
    seconds: float


@dataclass
class FaultInjection:
    """The faults that will happen on one link.

    Attributes
    ----------
    is_unplugged, is_mute : bool
        Set by a DISCONNECT and by a MUTE.
    """

    is_unplugged: bool = False
    is_mute: bool = False
    _due: list[_Due] = field(default_factory=list)
    _held_back: bytes = b""

    def add(self, fault: InjectedFault | str, after: int = 0, seconds: float = 0.0) -> None:
        """Let one fault happen.

        Parameters
        ----------
        fault : InjectedFault or str
            Its kind.
        after : int
            Number of transfers in its direction that pass before.
        seconds : float
            Duration of a STALL, in seconds.
        """
        self._due.append(_Due(InjectedFault(fault), after, seconds))

    def outward(self, data: bytes) -> Iterator[bytes | float | OSError]:
        """Yield the events that a transfer to the device turns into.

        Yields
        ------
        bytes, float or OSError
            Bytes that arrive, seconds that pass, an error that the sender sees.
        """
        fault, seconds = self._next(of_answers=False)
        if fault is InjectedFault.DISCONNECT:
            self.is_unplugged = True
            yield OSError(errno.ENODEV, "No such device (it may have been disconnected)")
            return
        if self._held_back:
            yield self._held_back
            self._held_back = b""
        half = data[: len(data) // 2]
        if fault is InjectedFault.LOSE:
            return
        if fault is InjectedFault.DELAY:
            self._held_back = data
        elif fault is InjectedFault.CORRUPT:
            yield _with_a_wrong_bit(data)
        elif fault is InjectedFault.CUT:
            yield half
        elif fault is InjectedFault.SHORT_WRITE:
            yield half
            yield OSError(errno.EIO, "Input/output error")
        elif fault is InjectedFault.TIME_OUT:
            yield OSError(errno.ETIMEDOUT, "Operation timed out")
        else:
            if fault is InjectedFault.NOISE:
                yield b"\x00noise\xff"
            elif fault is InjectedFault.STALL:
                yield seconds
            elif fault is InjectedFault.REPEAT:
                yield data
            yield data

    def inward(self, data: bytes) -> bytes:
        """Return the bytes of an answer that arrive."""
        fault, _ = self._next(of_answers=True)
        self.is_mute |= fault is InjectedFault.MUTE
        if self.is_mute or fault is InjectedFault.LOSE_ANSWER:
            return b""
        return _with_a_wrong_bit(data) if fault is InjectedFault.CORRUPT_ANSWER else data

    def _next(self, of_answers: bool) -> tuple[InjectedFault | None, float]:
        """Count one transfer; return its fault and the duration of that."""
        happens: tuple[InjectedFault | None, float] = (None, 0.0)
        if not self._due:
            return happens
        for due in [due for due in self._due if (due.fault in _OF_ANSWERS) == of_answers]:
            if due.transfers_left == 0 and happens[0] is None:
                happens = due.fault, due.seconds
                self._due.remove(due)
            else:
                due.transfers_left = max(due.transfers_left - 1, 0)
        return happens


def _with_a_wrong_bit(data: bytes) -> bytes:
    """Flip a bit near the end; in a STREAM frame it belongs to a sample."""
    at = max(len(data) - 6, 0)
    return data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :] if data else data


class FaultyLink(MockLink):
    """A link to the mock, with the faults that will happen on it in `injected`."""

    def __init__(
        self,
        driver: MockDriver | None = None,
        report_bytes: int | None = None,
        sleep: Callable[[float], None] | None = None,
    ) -> None:
        super().__init__(driver, report_bytes, sleep)
        self.injected = FaultInjection()
        self._is_shut = False
        self._wait = self.clock.sleep if sleep is None else sleep

    def inject(self, fault: InjectedFault | str, after: int = 0, seconds: float = 0.0) -> None:
        """Let one fault happen; see `FaultInjection.add`."""
        self.injected.add(fault, after, seconds)

    def send(self, data: bytes) -> None:
        self._check_open_and_plugged()
        size = self.report_bytes
        for transfer in [data] if size is None else to_reports(data, size):
            for event in self.injected.outward(transfer):
                self._apply(event)

    def receive(self, timeout_s: float = 0.0) -> bytes:
        self._check_open_and_plugged()
        end_s = self.driver.clock() + timeout_s
        while data := super().receive(max(0.0, end_s - self.driver.clock())):
            if arrived := self.injected.inward(data):
                return arrived
        return b""

    def _apply(self, event: bytes | float | OSError) -> None:
        if isinstance(event, OSError):
            if self.injected.is_unplugged:
                self.driver.release()
                self._check_open_and_plugged()
            raise event
        if isinstance(event, float):
            if self.driver.pace == "virtual":
                self.driver.advance(event)
            else:
                self._wait(event)
        elif event and self.report_bytes is None:
            super().send(event)
        elif event:
            self.driver.receive_report(event)

    def close(self) -> None:
        self._is_shut = True
        super().close()

    def _check_open_and_plugged(self) -> None:
        if self._is_shut:
            raise DeviceDisconnectedError("The faulty link is closed; open the device again.")
        if self.injected.is_unplugged:
            raise DeviceDisconnectedError(
                "The mock's cable is unplugged (injected); plug it in and open the device again."
            )
