"""A scheme of addresses: how a link is opened by one, and how its bus is searched.

A package declares its schemes as entry points of the group "haptix.links".
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from firmware_io.address import Read
from firmware_io.errors import DeviceError
from firmware_io.link import Link

_GROUP = "haptix.links"

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
    """A kind of link, as the module that has it describes it.

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


@cache
def scheme_names() -> tuple[str, ...]:
    """Return the schemes of all links that are installed."""
    return tuple(_links())


def scheme(name: str) -> Scheme:
    """Return one of those.

    Raises
    ------
    DeviceError
        If its module cannot be imported, or has no scheme there.
    """
    link = _links()[name]
    try:
        loaded = link.load()
    # Whatever another package raises when it is imported.
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
    installed = sorted(
        entry_points(group=_GROUP), key=lambda link: not link.module.startswith("firmware_io.")
    )
    project = Path(__file__).parents[1] / "pyproject.toml"
    if project.is_file():  # a checkout, which may be newer than its installation
        own = tomllib.loads(project.read_text(encoding="utf-8"))["project"]["entry-points"][_GROUP]
        installed[:0] = (EntryPoint(name, value, _GROUP) for name, value in own.items())
    links: dict[str, EntryPoint] = {}
    for link in installed:
        links.setdefault(link.name, link)  # no other package takes the place of one of ours
    return links
