"""A link, by which bytes go to a driver and back, and the addresses that open one.

An address is a scheme, a colon, and the key=value pairs of that scheme. A scheme defines how to
open a link by an address, and how to search its bus. A module of `firmware_io.links` with a
`SCHEME` adds one under the module's name; another package adds its own by entry points of the group
"haptix.links".
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from firmware_io.clock import HOST_CLOCK, Clock
from firmware_io.device_errors import DeviceError, DeviceNotFoundError


@dataclass(frozen=True)
class Bulk:
    """Two bulk endpoints of an open USB device, for a player in C."""

    transfer: int
    """Address of ``libusb_bulk_transfer``."""
    handle: int
    """Address of the device's handle."""
    outward: int
    inward: int


class Link(ABC):
    """Carries bytes to one driver and back.

    A link knows neither limits nor frames. `firmware_io.Device` owns it and speaks the protocol
    through it. An implementation turns its library's errors into those of
    `firmware_io.device_errors`; it may let an OSError pass, which counts as a lost link. Only one
    thread uses a link at a time.
    """

    name: str
    """The driver's name in messages, such as its address."""
    clock: Clock = HOST_CLOCK
    """Clock by which the host waits for the driver."""
    report_bytes: int | None = None
    """Size of the reports that carry the bytes (HID); None if a write may have any size."""
    bytes_per_s: float | None = None
    """Bytes that the link carries in a second; None if it has no limit of its own."""
    wakes_s: float = 0.0
    """Longest time for which a driver may be deaf after its link was opened, as it starts up."""

    @property
    def descriptor(self) -> int | None:
        """File descriptor of a link that is open, if reading and writing it never wait.

        None if the bytes go through a library.
        """
        return None

    @property
    def reports_node(self) -> Path | None:
        """File of an open HID device that another descriptor can share; see `report_bytes`.

        Each descriptor has its own queue of the reports that come.
        """
        return None

    @property
    def bulk(self) -> Bulk | None:
        """Endpoints of a link that is open, if it is two of USB."""
        return None

    @property
    def latency_s(self) -> float | None:
        """Delay that the link adds between a sample and the output, in seconds; None if unknown."""
        return 0.0

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Deliver all bytes, in order.

        Raises
        ------
        DeviceDisconnectedError
            If the link is closed or lost. The bytes may or may not have arrived.
        """

    @abstractmethod
    def receive(self, timeout_s: float = 0.0) -> bytes:
        """Return the bytes from the driver; empty if none came within the timeout.

        Raises
        ------
        DeviceDisconnectedError
            If the link is closed or lost.
        """

    @abstractmethod
    def close(self) -> None:
        """Close the link. The driver ends at 0 V, at the latest by its watchdog. Idempotent."""


Read = Callable[[str], Any]


def number(text: str) -> float:
    """Return a number that is not NaN; an infinite one is for the caller to refuse."""
    value = float(text)
    if math.isnan(value):
        raise ValueError("not a number")
    return value


def count(text: str) -> int:
    """Return a whole number, hexadecimal after 0x."""
    return int(text, 0)


def hexadecimal(text: str) -> int:
    """Return a USB number as lsusb writes it."""
    return int(text, 16)


def yes_or_no(text: str) -> bool:
    """Return True for yes, true or 1, False for no, false or 0."""
    words = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False}
    if text.lower() not in words:
        raise ValueError(text)
    return words[text.lower()]


def one_of(*words: str) -> Read:
    """Return a reader that accepts only these words."""

    def read(text: str) -> str:
        if text not in words:
            raise ValueError(text)
        return text

    read.__doc__ = f"One of {', '.join(words)}"
    return read


_EXPECTED: Mapping[Any, str] = {
    number: "a number",
    float: "a number",
    count: "a whole number",
    int: "a whole number",
    hexadecimal: "a hexadecimal number of up to four digits",
    yes_or_no: "yes or no",
}

#: Keys of every scheme: how the driver plays samples.
SETTING_KEYS: Mapping[str, Read] = {
    "mode": one_of("waveform", "envelope"),
    "carrier_hz": number,
    "sample_rate_hz": number,
    "lead_s": number,
    "watchdog_s": number,
}


def split_address(address: object, schemes: Iterable[str]) -> tuple[str, str]:
    """Return the scheme and the selector of an address.

    Raises `DeviceError` if the address is not a string; `DeviceNotFoundError` if its scheme is
    unknown.
    """
    if not isinstance(address, str):
        raise DeviceError(
            f"An address must be a string, but is {address!r}, of type {type(address).__name__}; "
            'use for example "mock:".'
        )
    scheme, colon, selector = address.partition(":")
    if scheme == "scpi":
        raise DeviceNotFoundError(
            f"{address!r} is a function generator, which plays whole stimuli and is no driver that "
            "can be opened, streamed to or proven; use firmware_io.FunctionGenerator instead."
        )
    if not colon or scheme not in schemes:
        known = ", ".join(f"{name}:" for name in schemes)
        raise DeviceNotFoundError(
            f"An address begins with one of {known}, but {address!r} does not; "
            "`haptix devices` lists the connected devices."
        )
    return scheme, selector


def read_selector(scheme: str, selector: str, keys: Mapping[str, Read]) -> dict[str, Any]:
    """Return the values of a selector, by key.

    Raises
    ------
    DeviceError
        If a key is unknown or repeated, or a value cannot be read. The message lists the keys.
    """
    known = ", ".join(keys)
    values: dict[str, Any] = {}
    pairs: list[str] = []
    for piece in selector.split(",") if selector else ():
        # A name may have commas: what has no "=" goes on with the text before it.
        if pairs and "=" not in piece and keys.get(pairs[-1].partition("=")[0].strip()) is str:
            pairs[-1] += f",{piece}"
        else:
            pairs.append(piece)
    for pair in pairs:
        key, _, text = (part.strip() for part in pair.partition("="))
        if key not in keys or key in values:
            raise DeviceError(
                f"{scheme}: takes key=value pairs, each key once, but {key!r} came; "
                f"the keys are {known}."
            )
        read = keys[key]
        try:
            values[key] = read(text)
        except ValueError:
            expected = _EXPECTED.get(read) or (read.__doc__ or "a text").lower()
            raise DeviceError(
                f"{key} of {scheme}: must be {expected}, but {text!r} came. The keys are {known}."
            ) from None
    return values


_GROUP = "haptix.links"
_SCHEMES = ("audio", "daq", "hid", "mock", "serial", "tcp", "usb")  # modules of firmware_io.links

#: The note of a device whose numbers are not those of a haptix driver.
OTHER_DEVICE = "Another device, not a haptix driver by its numbers."


@dataclass(frozen=True)
class DeviceInfo:
    """One device that was found.

    Parameters
    ----------
    address : str
        Argument of `open_device`.
    kind : str
        The scheme of its address, such as "usb".
    name : str
        Name for display.
    usable : bool
        Whether `open_device` would try to drive it.
    note : str
        Remark for the user.
    """

    address: str
    kind: str
    name: str
    usable: bool
    note: str


@dataclass(frozen=True)
class Bus:
    """A bus that can be searched without opening anything.

    Parameters
    ----------
    search : callable
        Returns the library with its version, and the devices. It may raise anything.
    remedy : str
        What to install if it raises.
    is_slow : bool
        Whether a search takes so long that a watch makes it every few seconds only.
    """

    search: Callable[[], tuple[str, list[DeviceInfo]]]
    remedy: str
    is_slow: bool = False


@dataclass(frozen=True)
class Scheme:
    """A kind of link, as its module describes it.

    Parameters
    ----------
    open : callable
        Returns the link; takes the values of `keys` that the address gives, by name.
    keys : mapping of str to callable
        Keys of its addresses besides `firmware_io.link.SETTING_KEYS`, and the reader of each.
    split : callable, optional
        Takes a selector; returns the values before its keys, and the rest.
    bus : Bus, optional
        The bus of its devices.
    makes_rate : bool
        Whether the link itself sets the sample rate, and takes `sample_rate_hz`.
    """

    open: Callable[..., Link]
    keys: Mapping[str, Read] = field(default_factory=dict)
    split: Callable[[str], tuple[dict[str, Any], str]] = lambda selector: ({}, selector)
    bus: Bus | None = None
    makes_rate: bool = False


@cache
def scheme_names() -> tuple[str, ...]:
    """Return the schemes of all links that are installed."""
    return tuple(_links())


def scheme(name: str) -> Scheme:
    """Return one of these schemes.

    Raises `DeviceError` if its module cannot be imported, or has no scheme.
    """
    link = _links()[name]
    try:
        loaded = link.load()
    # The import of another package may raise anything.
    except Exception as error:
        raise DeviceError(
            f"{name}: cannot be used, since {link.value} fails: {error}; mend or remove the "
            "package that brings it."
        ) from error
    if not isinstance(loaded, Scheme):
        raise DeviceError(
            f"{name}: cannot be used, since {link.value} is no firmware_io.Scheme, but "
            f"{loaded!r:.80}; mend or remove the package that brings it."
        )
    return loaded


@cache
def _links() -> dict[str, EntryPoint]:
    """Entry points by scheme. Another package cannot replace a scheme of this one."""
    ours = {name: EntryPoint(name, f"firmware_io.links.{name}:SCHEME", _GROUP) for name in _SCHEMES}
    return {link.name: link for link in entry_points(group=_GROUP)} | ours
