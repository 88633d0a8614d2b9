"""HID reports of touch panels: which bits are fingers, by the report descriptor (HID 1.11)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple, Self

from haptix.base.errors import FileFormatError
from haptix.play.touch.touchscreen import (
    ABS_MT_DISTANCE,
    ABS_MT_POSITION_X,
    ABS_MT_POSITION_Y,
    ABS_MT_TRACKING_ID,
    EV_ABS,
    EV_SYN,
    SYN_MT_REPORT,
    SYN_REPORT,
)

_X, _Y = 0x10030, 0x10031
_TIP, _CONFIDENCE, _CONTACT, _COUNT = 0xD0042, 0xD0047, 0xD0051, 0xD0054
_UNSEEN_S = 0.1  # after which hid-multitouch lifts a contact of a panel that does not report it
_MOST_USAGES, _MOST_BITS = 12288, 256  # of a descriptor, and of one value; Linux takes as many
_MM = {0x11: 10.0, 0x13: 25.4}  # units of length, centimetre and inch, of the linear systems


class _Field(NamedTuple):
    """One value of a report."""

    usage: int
    bit: int
    bits: int
    low: int
    high: int
    length_mm: float | None
    finger: int
    """Number of its innermost collection; a physical one without a usage does not count."""


@dataclass
class HidReports:
    """Reports of a touch panel, as events of protocol A.

    Parameters
    ----------
    fields : dict
        Fields of each report, by its id; 0 where reports have no ids.
    """

    fields: dict[int, list[_Field]]
    _contacts: dict[int, tuple[float, dict[int, int]]] = field(default_factory=dict)
    _expected: int = 0
    _received: int = 0

    @classmethod
    def of(cls, descriptor: bytes) -> Self | None:
        """Return the reports of a panel's descriptor; None where none holds a finger.

        Raises `FileFormatError` if it is cut off, or has more usages, values or bits than a panel.
        """
        try:
            found = _fields(descriptor)
        except IndexError:
            raise FileFormatError(
                "report descriptor: expected whole items, and that each collection begins first"
            ) from None
        fields = {
            number: each for number, each in found.items()
            if {one.usage for one in each} >= {_X, _Y, _TIP}
        }  # fmt: skip
        return cls(fields) if fields else None

    @property
    def axes(self) -> Iterator[tuple[int, tuple[int, int]]]:
        """Codes and ranges of x and y."""
        for code, usage in ((ABS_MT_POSITION_X, _X), (ABS_MT_POSITION_Y, _Y)):
            one = self._first(usage)
            yield code, (one.low, one.high)

    @property
    def size_mm(self) -> tuple[float, float] | None:
        """Size that the descriptor states, without the kernel's rounding."""
        width, height = self._first(_X).length_mm, self._first(_Y).length_mm
        return None if width is None or height is None else (width, height)

    def events(self, t_s: float, report: bytes) -> Iterator[tuple[int, int, int]]:
        """Yield events (type, code, value) of a report; the last one of a frame brings all of it.

        As in Linux' hid-multitouch, a frame has as many contacts as it counts, in one report or
        several, each of which may repeat the count; a contact that is not in a frame stays as it
        was, for 0.1 s. Without a count a report is a frame, and a contact that is not in it stays.

        Parameters
        ----------
        t_s : float
            Time of the report [s].
        report : bytes
        """
        number = report[0] if 0 not in self.fields else 0
        values: dict[int, dict[int, int]] = {}
        for one in self.fields.get(number, ()):
            raw = int.from_bytes(report, "little") >> one.bit & ((1 << one.bits) - 1)
            if one.low < 0 and raw >> (one.bits - 1):
                raw -= 1 << one.bits
            values.setdefault(one.finger, {})[one.usage] = raw
        if not values:
            return
        fingers = [each for each in values.values() if each.keys() >= {_X, _Y, _TIP}]
        counts = [each[_COUNT] for each in values.values() if _COUNT in each]
        self._expected = [*counts, len(fingers)][0] or self._expected
        stays_s = _UNSEEN_S if counts else inf
        for finger in fingers[: self._expected - self._received]:
            self._contacts[finger.get(_CONTACT, self._received)] = t_s + stays_s, finger
            self._received += 1
        if self._received < self._expected:
            return  # the next report goes on with this frame
        touching = {}
        for contact, (until_s, finger) in self._contacts.items():
            yield EV_ABS, ABS_MT_TRACKING_ID, contact
            yield EV_ABS, ABS_MT_POSITION_X, finger[_X]
            yield EV_ABS, ABS_MT_POSITION_Y, finger[_Y]
            touches = finger[_TIP] and finger.get(_CONFIDENCE, 1) and t_s < until_s
            yield EV_ABS, ABS_MT_DISTANCE, 0 if touches else 1
            yield EV_SYN, SYN_MT_REPORT, 0
            if touches:
                touching[contact] = until_s, finger
        if not self._contacts:
            yield EV_SYN, SYN_MT_REPORT, 0
        yield EV_SYN, SYN_REPORT, 0
        self._contacts, self._expected, self._received = touching, 0, 0

    def _first(self, usage: int) -> _Field:
        return next(one for each in self.fields.values() for one in each if one.usage == usage)


def _fields(descriptor: bytes) -> dict[int, list[_Field]]:
    """Return the input fields of each report; see HID 1.11, section 6.2.2."""
    found: dict[int, list[_Field]] = {}
    bits: dict[int, int] = {}
    state: dict[int, int] = {}  # global items, by tag
    saved: list[dict[int, int]] = []
    usages: list[int] = []
    least = values = 0
    contacts: set[tuple[int, int]] = set()  # fingers of a report that have an identifier
    collections, finger = [0], 0
    at = 0
    while at < len(descriptor):
        prefix = descriptor[at]
        if prefix == 0xFE:  # a long item, of which none is defined
            at += 3 + descriptor[at + 1]
            continue
        size = (0, 1, 2, 4)[prefix & 3]
        data = descriptor[at + 1 : at + 1 + size]
        at += 1 + size
        tag, value = prefix & 0xFC, int.from_bytes(data, "little")
        signed = int.from_bytes(data, "little", signed=True)
        page = state.get(0x04, 0) << 16
        if tag == 0xA4:  # push
            saved.append(dict(state))
        elif tag == 0xB4 and saved:  # pop
            state = saved.pop()
        elif tag & 0x0C == 0x04:  # another global item; limits and exponents are signed
            state[tag] = signed if tag in (0x14, 0x24, 0x34, 0x44, 0x54) else value
        elif tag == 0x08:
            usages.append(value if size == 4 else page | value)
        elif tag == 0x18:
            least = value if size == 4 else page | value
        elif tag == 0x28:
            last = value if size == 4 else page | value
            _check_at_most(_MOST_USAGES, "usages", len(usages) + last - least)
            usages += range(least, last + 1)
        elif tag == 0xA0:
            # A physical one without a usage, such as that of a place, belongs to the one around it.
            is_part = value == 0 and not usages
            finger += not is_part
            collections.append(collections[-1] if is_part else finger)
            usages = []
        elif tag == 0xC0:
            collections.pop()
        elif tag in (0x80, 0x90, 0xB0):
            report, width, count = state.get(0x84, 0), state.get(0x74, 0), state.get(0x94, 0)
            _check_at_most(_MOST_BITS, "bits of a value", width)
            if tag == 0x80:
                values += count
                _check_at_most(_MOST_USAGES, "values in all reports", values)
                start = bits.setdefault(report, 8 if report else 0)
                for number in range(count):
                    if usages and not value & 1:  # data, no constant
                        usage = usages[min(number, len(usages) - 1)]
                        before = found.setdefault(report, [])
                        if usage == _CONTACT:
                            if (report, collections[-1]) in contacts:
                                finger += 1  # another finger, without a collection of its own
                                collections[-1] = finger
                            contacts.add((report, collections[-1]))
                        before.append(
                            _Field(
                                usage,
                                start + number * width,
                                width,
                                state.get(0x14, 0),
                                state.get(0x24, 0),
                                _length_mm(state),
                                collections[-1],
                            )
                        )
                bits[report] = start + width * count
            usages = []
    return found


def _check_at_most(most: int, what: str, count: int) -> None:
    if count > most:
        raise FileFormatError(f"report descriptor: expected at most {most} {what}, got {count}")


def _length_mm(state: dict[int, int]) -> float | None:
    unit_mm = _MM.get(state.get(0x64, 0))
    length = state.get(0x44, 0) - state.get(0x34, 0)
    exponent = state.get(0x54, 0)
    exponent = exponent - 16 if 8 <= exponent <= 15 else exponent
    if unit_mm is None or length <= 0 or not -8 <= exponent <= 7:  # of four bits
        return None
    return float(length * unit_mm * 10.0**exponent)
