"""Addresses: a scheme, a colon, and the key=value pairs of that scheme."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from firmware_io.errors import DeviceError, DeviceNotFoundError

Read = Callable[[str], Any]


def number(text: str) -> float:
    """Return a finite number."""
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

    Raises
    ------
    DeviceError
        If the address is not a string.
    DeviceNotFoundError
        If its scheme is unknown.
    """
    if not isinstance(address, str):
        raise DeviceError(
            f"An address must be a string, but is {address!r}, of type {type(address).__name__}; "
            'use for example "mock:".'
        )
    scheme, colon, selector = address.partition(":")
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
    for pair in selector.split(",") if selector else ():
        key, _, text = (part.strip() for part in pair.partition("="))
        if key not in keys or key in values:
            raise DeviceError(
                f"{scheme}: takes key=value pairs, each key once, but {pair!r} came; "
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
