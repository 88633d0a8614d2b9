"""A scheme of addresses: how a link is opened by one, and how its bus is searched."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from firmware_io.address import Read
from firmware_io.link import Link

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
        What to install where it raises.
    """

    search: Callable[[], tuple[str, list[DeviceInfo]]]
    remedy: str


@dataclass(frozen=True)
class Scheme:
    """A kind of link, as each module of `firmware_io.links` describes it.

    Parameters
    ----------
    open : callable
        Returns the link; takes the values of `keys` that the address gives, by name.
    keys : mapping of str to callable
        Keys of its addresses besides `firmware_io.address.SETTING_KEYS`, and what reads each.
    split : callable, optional
        Takes a selector; returns the values that stand before its keys, and the rest.
    bus : Bus, optional
        Where its devices are found.
    makes_rate : bool
        Whether the link itself makes the sample rate, and takes `sample_rate_hz`.
    """

    open: Callable[..., Link]
    keys: Mapping[str, Read] = field(default_factory=dict)
    split: Callable[[str], tuple[dict[str, Any], str]] = lambda selector: ({}, selector)
    bus: Bus | None = None
    makes_rate: bool = False
