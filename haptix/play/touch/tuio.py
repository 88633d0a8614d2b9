"""Touches by TUIO 1.1 and 2.0, as tables, infrared frames and lidars send them over UDP."""

from __future__ import annotations

import select
import socket
import struct
import time
from collections.abc import Iterator, Sequence
from math import isfinite
from typing import Any, Self

from haptix.base.checks import positive, whole
from haptix.base.errors import DeviceError, InputError
from haptix.play.touch.events import TouchEvent, free_id
from haptix.play.touch.orientation import Matrix, checked_matrix
from haptix.play.touch.touchscreen import PanelClock

PORT = 3333
"""The port of TUIO."""
_ENDS_S = 1.5  # without a message, a source has ended; it repeats itself each second
_LATE_FRAMES = 100  # a frame that is older by fewer comes late, by more from a source begun anew
_BUNDLE = b"#bundle\0"
_NUMBERS = {"i": ">i", "f": ">f", "h": ">q", "d": ">d", "t": ">Q"}
_WORDS = {"T": True, "F": False, "N": None, "I": None}


class TuioDecoder:
    """Turns packets of TUIO into touches: cursors (2Dcur, 25Dcur) of 1.1, and pointers of 2.0.

    A cursor above the surface is no touch: its height is above 0 (25Dcur), or its pressure below 0
    (2.0). Sources that name themselves, or have other addresses, have fingers of their own.

    Parameters
    ----------
    width_mm, height_mm : float
        Size of the surface, whose places TUIO states as shares of its sides.
    matrix : tuple of 6 float, or str
        How the surface lies on the picture, see `ScreenAxes`.
    """

    def __init__(self, width_mm: float, height_mm: float, matrix: Matrix | str = "normal") -> None:
        self._sides = positive("width_mm", width_mm), positive("height_mm", height_mm)
        self._matrix = checked_matrix(matrix)
        self.dropped = 0
        """Number of packets that are no TUIO, or came late."""
        self._clock = PanelClock()
        self._ids: dict[tuple[str, int], int] = {}  # touches that are down
        self._frames: dict[str, int] = {}
        self._names: dict[str, str] = {}  # of sources, by their addresses
        self._heard_s: dict[str, float] = {}  # each source's last message

    def feed(self, packet: bytes, arrival_s: float, sender: str = "") -> list[TouchEvent]:
        """Take a packet of OSC; return its touches, and the lifts of sources that fell silent.

        Parameters
        ----------
        packet : bytes
        arrival_s : float
            When it came [s]. TUIO 2.0 states times, which count where they agree, see `PanelClock`.
        sender : str
            Address that it came from: a source that names itself in no message is known by it.
        """
        try:
            messages = [*_messages(packet)]
            return [
                *self._profile("/tuio/2Dcur", messages, arrival_s, sender),
                *self._profile("/tuio/25Dcur", messages, arrival_s, sender),
                *self._pointers(messages, arrival_s, sender),
                *self.end(arrival_s, _ENDS_S),
            ]
        except (struct.error, ValueError, IndexError, TypeError, KeyError, RecursionError):
            self.dropped += 1
            return []

    def end(self, t_s: float, silent_s: float = 0.0) -> list[TouchEvent]:
        """Return the lifts of all that is down.

        Parameters
        ----------
        t_s : float
            Time of the lifts [s].
        silent_s : float
            Of sources alone that have sent nothing for so long [s].
        """
        ended = [one for one, heard_s in self._heard_s.items() if t_s - heard_s >= silent_s]
        for source in ended:
            del self._heard_s[source]
            self._frames.pop(source, None)
        if ended:
            heard = {key.partition(" ")[2] for key in self._heard_s}
            self._names = {at: name for at, name in self._names.items() if name in heard}
        gone = [key for key in self._ids if key[0] in ended]
        return [TouchEvent(t_s, self._ids.pop(key), 0.0, 0.0, "up") for key in gone]

    def _source(self, profile: str, name: str, sender: str, t_s: float) -> str:
        """Return the key of a source; one that names itself does so in some bundles or in all."""
        name = self._names[sender] = name or self._names.get(sender, sender)
        self._heard_s[key := f"{profile} {name}"] = t_s
        return key

    def _profile(
        self, address: str, messages: Sequence[tuple[str, list[Any]]], t_s: float, sender: str
    ) -> list[TouchEvent]:
        """Touches of one profile of TUIO 1.1."""
        found = [arguments for name, arguments in messages if name == address]
        alive = next(([*map(int, a[1:])] for a in found if a[0] == "alive"), None)
        if alive is None:
            return []
        name = next((str(a[1]) for a in found if a[0] == "source"), "")
        source = self._source(address, name, sender, t_s)
        frame = next((int(a[1]) for a in found if a[0] == "fseq"), -1)
        if frame >= 0 and self._is_late(source, frame):
            return []
        height = 4 if address == "/tuio/25Dcur" else None
        touching = {
            int(a[1]): (float(a[2]), float(a[3]))
            for a in found
            if a[0] == "set" and (height is None or float(a[height]) <= 0)
        }
        above = {int(a[1]) for a in found if a[0] == "set"} - touching.keys()
        return self._touches(source, [i for i in alive if i not in above], touching, t_s)

    def _pointers(
        self, messages: Sequence[tuple[str, list[Any]]], arrival_s: float, sender: str
    ) -> list[TouchEvent]:
        """Touches of TUIO 2.0."""
        alive = next(([*map(int, a)] for name, a in messages if name == "/tuio2/alv"), None)
        if alive is None:
            return []
        t_s = arrival_s
        frames = [a for name, a in messages if name == "/tuio2/frm"]
        named = next((str(a[3]) for a in frames if len(a) > 3), "")
        source = self._source("/tuio2/ptr", named, sender, arrival_s)
        for a in frames:
            if self._is_late(source, int(a[0])):
                return []
            # Seconds since 1900 and their fraction; 1 stands for "now".
            told_us = (int(a[1]) * 1_000_000) >> 32
            t_s = self._clock.stamp(arrival_s, told_us if int(a[1]) > 1 else None)
        found = {int(a[0]): a for name, a in messages if name == "/tuio2/ptr"}
        touching = {
            number: (float(a[3]), float(a[4]))
            for number, a in found.items()
            if len(a) < 9 or float(a[8]) >= 0
        }
        above = found.keys() - touching.keys()
        return self._touches(source, [i for i in alive if i not in above], touching, t_s)

    def _is_late(self, source: str, frame: int) -> bool:
        last = self._frames.get(source, -1)
        if 0 < last - frame < _LATE_FRAMES:
            self.dropped += 1
            return True
        self._frames[source] = frame
        return False

    def _touches(
        self,
        source: str,
        alive: Sequence[int],
        places: dict[int, tuple[float, float]],
        t_s: float,
    ) -> list[TouchEvent]:
        gone = [key for key in self._ids if key[0] == source and key[1] not in alive]
        touches = [TouchEvent(t_s, self._ids.pop(key), 0.0, 0.0, "up") for key in gone]
        a, b, c, d, e, f = self._matrix
        for number, (x, y) in places.items():
            if number not in alive:
                continue
            if not (isfinite(x) and isfinite(y)):
                raise ValueError("no place")
            is_new = (source, number) not in self._ids
            if is_new:
                lifted = [touch.touch_id for touch in touches if touch.kind == "up"]
                self._ids[source, number] = free_id([*self._ids.values(), *lifted])
            width_mm, height_mm = self._sides
            touches.append(
                TouchEvent(
                    t_s, self._ids[source, number], width_mm * (a * x + b * y + c),
                    height_mm * (d * x + e * y + f), "down" if is_new else "move",
                )
            )  # fmt: skip
        return touches


class TuioSource:
    """Touches that come by TUIO over UDP, read without waiting; see `TuioDecoder`.

    Parameters
    ----------
    width_mm, height_mm, matrix
        See `TuioDecoder`.
    port : int
        UDP port to listen on.
    host : str
        Address of this machine to listen at; "" takes packets of other machines too.

    Raises
    ------
    DeviceError
        If the port is taken.
    """

    def __init__(
        self,
        width_mm: float,
        height_mm: float,
        matrix: Matrix | str = "normal",
        port: int = PORT,
        host: str = "127.0.0.1",
    ) -> None:
        self._decoder = TuioDecoder(width_mm, height_mm, matrix)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host, whole("port", port)))
        except InputError:
            self.close()
            raise
        except (OSError, OverflowError) as error:
            self.close()
            raise DeviceError(
                f"cannot listen for TUIO on port {port}: {error}; has another program the port?"
            ) from None

    @property
    def port(self) -> int:
        """Port on which it listens."""
        return int(self._socket.getsockname()[1])

    @property
    def dropped(self) -> int:
        """Number of packets that are no TUIO, or came late."""
        return self._decoder.dropped

    def read(self, timeout_s: float = 0.0) -> list[TouchEvent]:
        """Return the touches so far; if there are none, wait for up to `timeout_s`.

        Touches of a source end when it was silent for 1.5 s: sources repeat themselves each second.
        """
        touches: list[TouchEvent] = []
        ready = select.select([self._socket], [], [], timeout_s)[0]
        while ready:
            try:
                packet, sender = self._socket.recvfrom(1 << 16)
            except BlockingIOError:
                break
            touches += self._decoder.feed(packet, time.monotonic(), f"{sender[0]}:{sender[1]}")
        return touches + self._decoder.end(time.monotonic(), _ENDS_S)

    def close(self) -> None:
        """Close the port."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _messages(packet: bytes) -> Iterator[tuple[str, list[Any]]]:
    """Yield address and arguments of each message of an OSC 1.0 packet."""
    if packet.startswith(_BUNDLE):
        at = 16
        while at < len(packet):
            (size,) = struct.unpack_from(">i", packet, at)
            if not 0 < size <= len(packet) - at - 4:
                raise ValueError("cut off")
            yield from _messages(packet[at + 4 : at + 4 + size])
            at += 4 + size
        return
    address, at = _text(packet, 0)
    kinds, at = _text(packet, at)
    arguments: list[Any] = []
    for kind in kinds.removeprefix(","):
        if kind in _NUMBERS:
            arguments += struct.unpack_from(_NUMBERS[kind], packet, at)
            at += struct.calcsize(_NUMBERS[kind])
        elif kind in "sS":
            text, at = _text(packet, at)
            arguments.append(text)
        elif kind == "b":
            (size,) = struct.unpack_from(">i", packet, at)
            arguments.append(packet[at + 4 : at + 4 + size])
            at += 4 + (size + 3) // 4 * 4
        else:
            arguments.append(_WORDS[kind])
    yield address, arguments


def _text(packet: bytes, at: int) -> tuple[str, int]:
    end = packet.index(0, at)
    return packet[at:end].decode("ascii"), end + 4 - (end - at) % 4
