"""A table of columns with the units that a file states, and units as files spell them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from haptix.base.checks import Array
from haptix.base.errors import FileFormatError

FEWEST_SAMPLES = 8
"""Of a table; a file with fewer is none."""

_UNIT = re.compile(r"(?P<name>.*?)\s*(?:[(\[](?P<unit>[^()\[\]]*)[)\]]|/\s*(?P<after>\w+))\s*")

OF_SIGNALS = frozenset(
    ["s", "ms", "us", "N", "mN", "gf", "kgf", "lbf", "m", "cm", "mm", "um", "inch", "V", "mV", "kV"]
)
"""Units of recordings, by which headings with a unit differ from other words."""

_ALIASES = {  # spellings of units in files
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms", "milliseconds": "ms",
    "microseconds": "us", "newton": "N", "newtons": "N", "millinewton": "mN", "grams": "gf",
    "g": "gf", "kg": "kgf", "lbs": "lbf", "lb": "lbf", "millimeter": "mm", "millimeters": "mm",
    "meter": "m", "in": "inch", "micron": "um", "microns": "um", "volt": "V", "volts": "V",
    "v": "V", "n": "N", "[s]": "s", "mv": "mV", "kv": "kV", "mn": "mN", "nsec": "ns",
    "nanoseconds": "ns", "minute": "min", "minutes": "min", "hours": "h",
}  # fmt: skip

TIMES_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
"""Seconds of the units of time."""


@dataclass(frozen=True)
class LabTable:
    """Columns of a file."""

    columns: Mapping[str, Array]
    """Numbers by the names of their columns; clock times are seconds since the first midnight."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units that the file states."""
    times_s: Mapping[str, Array] = field(default_factory=dict)
    """Times of a column's samples, where the file states them beside the columns."""
    rate_hz: float | None = None
    """Samples per second that a text file states above its columns."""
    understood: tuple[str, ...] = ()
    """Format of the layout, as it was understood."""

    def named(self, name: str) -> str | None:
        """Return the column of a name, with or without its unit; None where there is none."""
        wanted = name.strip()
        if wanted in self.columns:
            return wanted
        short = [column for column in self.columns if split_unit(column)[0] == wanted]
        return short[0] if len(short) == 1 else None

    def all_named(self, names: Sequence[str], path: str | Path) -> list[str]:
        """Return the columns of the names; raise `FileFormatError` where the file lacks one."""
        found = {name: self.named(name) for name in names}
        if missing := [name for name, column in found.items() if column is None]:
            raise FileFormatError(
                f"{path}: missing columns {', '.join(map(repr, missing))}; the file has "
                f"{', '.join(map(repr, self.columns))}"
            )
        return [column for column in found.values() if column is not None]


def split_unit(heading: str) -> tuple[str, str]:
    """Return name and unit of a heading such as "Fz (mN)", "Fz [mN]" or "Fz/mN".

    Examples
    --------
    >>> split_unit("Force Z [mN]"), split_unit("x")
    (('Force Z', 'mN'), ('x', ''))
    """
    match = _UNIT.fullmatch(heading)
    unit = known_unit(match["unit"] or match["after"] or "") if match else ""
    # Behind a bar it may be a channel of a group.
    if match is None or not match["name"] or (match["after"] and unit not in OF_SIGNALS):
        return heading.strip(), ""
    return match["name"].strip(), unit


def known_unit(text: str) -> str:
    """Return a unit in the spelling of column maps."""
    plain = text.strip().strip("()[]").strip().replace("\N{MICRO SIGN}", "u")
    plain = plain.replace("\N{GREEK SMALL LETTER MU}", "u")
    return _ALIASES.get(plain.lower(), plain)


def distinct(names: Iterable[str]) -> list[str]:
    """Names with a number behind those that came before: two channels of one name are two."""
    seen, distinct = Counter[str](), []
    for name in names:
        seen[name] += 1
        distinct.append(name if seen[name] == 1 else f"{name} {seen[name]}")
    return distinct
