"""The host's side of the protocol: numbers its frames, sends requests, reads the answers."""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Callable, Iterator

from firmware_io.clock import HOST_CLOCK, Clock
from firmware_io.device_errors import (
    DeviceDisconnectedError,
    DeviceError,
    DeviceFaultError,
    ProtocolError,
)
from firmware_io.link import Link
from firmware_io.progress import OutputClock
from firmware_io.protocol import (
    OLDEST_VERSION,
    SEQUENCE_MODULUS,
    VERSION,
    CapabilitiesReport,
    DeviceMessage,
    DeviceState,
    FaultCode,
    FaultReport,
    Frame,
    FrameParser,
    Hello,
    HostMessage,
    MarkedReport,
    Ping,
    SenseReading,
    SenseReport,
    StatusReport,
    Stop,
    TouchReport,
    encode,
)

_LOG = logging.getLogger("firmware_io.protocol")

ANSWER_S = 0.5
"""Longest time to an answer, in seconds: a full queue of reports and a busy host take less."""

_HELLO_S = ANSWER_S / 2
_BROKEN_OFF_S = 0.1  # PROTOCOL.md: a frame whose bytes pause this long is discarded
_KEPT_TOUCHES = 1024
_KEPT_READINGS = 4096  # a second at the highest rate
_READS = 4


class ProtocolClient:
    """Sends frames to one driver and reads its answers.

    Parameters
    ----------
    link : Link
        Carries the bytes.
    clock : Clock
        Clock of the host.

    Attributes
    ----------
    status : StatusReport or None
        The latest, received at `status_s` by the host's clock.
    fault : FaultReport or None
        The first fault that was not raised yet.
    touches : deque of TouchReport
        The latest touches of the panel, oldest first.
    marked : deque of MarkedReport
        The latest samples that were marked and played, oldest first.
    readings : deque of SenseReading
        The latest readings of the current, oldest first.
    marked_count : int
        Number of all that came.
    frames_sent, bytes_sent : int
        Delivered frames and bytes.
    output_clock : OutputClock
        The driver's clock against the host's, by its reports.
    version : int
        Version of the frames sent; until the handshake the oldest one.
    """

    def __init__(self, link: Link, clock: Clock = HOST_CLOCK) -> None:
        self.link = link
        self._process = os.getpid()
        self.clock = clock
        self.status: StatusReport | None = None
        self.status_s = 0.0
        self.fault: FaultReport | None = None
        self.touches: deque[TouchReport] = deque(maxlen=_KEPT_TOUCHES)
        self.marked: deque[MarkedReport] = deque(maxlen=_KEPT_TOUCHES)
        self.marked_count = 0
        self.readings: deque[SenseReading] = deque(maxlen=_KEPT_READINGS)
        self.frames_sent = 0
        self.bytes_sent = 0
        self.version = OLDEST_VERSION
        self.output_clock = OutputClock(1.0)
        self._sequence = 0
        self._token = 0
        self._parser = FrameParser(max_payload_bytes=1024)
        self._relayed = FrameParser(max_payload_bytes=1024)
        self._read_s = 0.0

    def handshake(self) -> CapabilitiesReport:
        """Begin a session.

        Raises `ProtocolError` if the device does not use this protocol, or uses another version of
        it.
        """
        damage: ProtocolError | None = None
        began_s, longest_s = self.clock(), ANSWER_S + self.link.wakes_s
        # Twice at least, since a report may be lost; HELLO is accepted in every state.
        for number in range(1, round(longest_s / _HELLO_S) + 1):
            self.version = OLDEST_VERSION
            _LOG.info("%s: HELLO is sent", self.link.name)
            self.send(Hello())
            for item in self._items(began_s + number * _HELLO_S):
                if isinstance(item, CapabilitiesReport):
                    rates_hz = (item.output_rate_hz, *(rate.sample_rate_hz for rate in item.rates))
                    if min(rates_hz) < 1:
                        raise ProtocolError(
                            f"{self.link.name} states rates of {rates_hz} Hz, and 0 is not "
                            "possible; write its firmware again."
                        )
                    self.fault = None
                    self.version = VERSION
                    self.output_clock = OutputClock(item.output_rate_hz)
                    _LOG.info("%s: speaks version %d", self.link.name, self.version)
                    return item
                if isinstance(item, FaultReport) and item.code is FaultCode.VERSION:
                    raise ProtocolError(f"{self.link.name}: {item} Bring both to the same version.")
                if isinstance(item, ProtocolError):
                    damage = item
        if damage is not None:
            raise ProtocolError(
                f"{self.link.name} answered, but not as a haptix driver does: {damage}"
            ) from damage
        raise ProtocolError(
            f"{self.link.name} did not answer HELLO within {longest_s:g} s; this is another "
            "device, or its firmware hangs: check the address, then replug it."
        )

    @property
    def is_inherited(self) -> bool:
        """Whether this process is a fork of the one that opened the link, and may not use it."""
        return os.getpid() != self._process

    def send(self, *messages: HostMessage) -> int:
        """Send messages, in one write unless the link has reports; return the number of bytes.

        The sequence advances only if all were delivered.
        """
        if self.is_inherited:
            raise DeviceError(
                f"{self.link.name} was opened by process {self._process}, which this one is a fork "
                "of; open it after the fork, in the process that plays."
            )
        frames = [
            encode(Frame(message, (self._sequence + place) % SEQUENCE_MODULUS), self.version)
            for place, message in enumerate(messages)
        ]
        if _LOG.isEnabledFor(logging.DEBUG):
            for message, frame in zip(messages, frames, strict=True):
                name = type(message).__name__
                _LOG.debug("%s > %s %s", self.link.name, name, frame.hex())
        try:
            if self.link.report_bytes is None:
                self.link.send(b"".join(frames))
            else:
                for frame in frames:
                    self.link.send(frame)
        except OSError as error:
            raise self.lost(error) from error
        size = sum(map(len, frames))
        self._sequence = (self._sequence + len(messages)) % SEQUENCE_MODULUS
        self.frames_sent += len(messages)
        self.bytes_sent += size
        return size

    @property
    def sequence(self) -> int:
        """Number of the next frame."""
        return self._sequence

    def take(self, frame: bytes, at_s: float) -> None:
        """Take a whole frame of the driver that a player in C has read, at a time of the host."""
        for item in self._relayed.feed(frame):
            self._take(item, at_s)

    def take_back(self, sequence: int, frames: int, size: int) -> None:
        """Count the samples that a player in C has sent.

        Parameters
        ----------
        sequence : int
            Number of the next frame.
        frames, size : int
            Frames and bytes that it has delivered.
        """
        self._sequence = sequence
        self.frames_sent += frames
        self.bytes_sent += size

    def ask(self, message: HostMessage) -> StatusReport:
        """Send a message to a driver that is not armed; return the STATUS that answers it.

        Raises `DeviceFaultError` if the driver refuses the message; `DeviceDisconnectedError` if no
        answer comes.
        """
        self.synchronise()
        self.fault = None
        due = (self._sequence + 1) % SEQUENCE_MODULUS
        self.send(message)
        return self._await(type(message).__name__, lambda status: status.next_sequence == due)

    def synchronise(self) -> StatusReport:
        """Read everything that the driver has sent so far; return its present STATUS."""
        self._token = (self._token + 1) % 2**32
        token = self._token
        self.send(Ping(token))
        # A fault from before this request must not hide the answer.
        return self._await("Ping", lambda status: status.token == token, is_patient=True)

    def send_stop(self) -> None:
        """Send STOP and wait until the driver reports that it is disarmed.

        A refusal is kept in `fault`; it, too, has ended the output. Raises
        `DeviceDisconnectedError` if STOP cannot be delivered or nothing answers it.
        """
        self.send(Stop())
        try:
            self._await("Stop", _is_disarmed)
        except DeviceFaultError:
            return

    def poll(self) -> None:
        """Read the driver's messages, at most `_READS` times: it may send without end."""
        for _ in range(_READS):
            if self._read(0.0) is None:
                return

    def raise_fault(self) -> None:
        """Raise the driver's fault, once."""
        if self.fault is not None:
            fault, self.fault = self.fault, None
            raise DeviceFaultError(
                f"The driver is in fault and at 0 V: {fault} Arm it again to go on."
            )

    def lost(self, error: OSError) -> DeviceDisconnectedError:
        """Return the error to raise for an error of the operating system."""
        return DeviceDisconnectedError(
            f"The link to {self.link.name} failed: {error}; check its cable and power, then open "
            "it again."
        )

    def _await(
        self, what: str, is_answer: Callable[[StatusReport], bool], is_patient: bool = False
    ) -> StatusReport:
        for item in self._items(self.clock() + ANSWER_S):
            if isinstance(item, StatusReport) and is_answer(item):
                return item
            if isinstance(item, FaultReport) and not is_patient:
                self.raise_fault()
        raise DeviceDisconnectedError(
            f"{self.link.name} did not answer {what.upper()} within {ANSWER_S:g} s; "
            "check its cable and power, then open it again."
        )

    def _items(self, end_s: float) -> Iterator[DeviceMessage | ProtocolError]:
        """Yield the driver's messages, until a time or until nothing comes."""
        while True:
            items = self._read(max(0.0, end_s - self.clock()))
            yield from items or ()
            if items is None or self.clock() > end_s:
                return

    def _read(self, timeout_s: float) -> list[DeviceMessage | ProtocolError] | None:
        """Return the driver's messages, in order; None if no byte came in time."""
        try:
            data = self.link.receive(timeout_s)
        except OSError as error:
            raise self.lost(error) from error
        now_s = self.clock()
        items: list[Frame | ProtocolError] = []
        if now_s - self._read_s > _BROKEN_OFF_S and self._parser.is_amid_a_frame:
            items += self._parser.give_up()
        if not data:
            return None
        self._read_s = now_s
        if _LOG.isEnabledFor(logging.DEBUG):
            _LOG.debug("%s < %s", self.link.name, data.hex())
        items += self._parser.feed(data)
        return [self._take(item, now_s) for item in items]

    def _take(self, item: Frame | ProtocolError, now_s: float) -> DeviceMessage | ProtocolError:
        if isinstance(item, ProtocolError):
            _LOG.info("%s: dropped bytes: %s", self.link.name, item)
            return item
        message = item.message
        if isinstance(message, StatusReport):
            self.status, self.status_s = message, now_s
            self.output_clock.observe(now_s, message.clock_ticks)
        elif isinstance(message, FaultReport):
            _LOG.info("%s: the driver's fault: %s", self.link.name, message)
            self.fault = self.fault or message
        elif isinstance(message, TouchReport):
            self.touches.append(message)
        elif isinstance(message, MarkedReport):
            self.marked.append(message)
            self.marked_count += 1
        elif isinstance(message, SenseReport):
            self.readings.extend(message.readings)
        elif not isinstance(message, CapabilitiesReport):
            return ProtocolError(
                f"{self.link.name} sent a {type(message).__name__.upper()}, which only hosts send; "
                "it echoes, or is another device."
            )
        return message


def _is_disarmed(status: StatusReport) -> bool:
    return status.state in (DeviceState.IDLE, DeviceState.RAMPING)
