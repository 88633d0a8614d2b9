"""A link by its address, and what a driver's firmware holds in memory."""

from __future__ import annotations

from typing import Any

from firmware_io.opening import read_address


def open_link(address: str) -> Any:
    """Return the link at an address, without its keys for the device."""
    scheme, values = read_address(address)
    return scheme.open(**values)


def stream_of(device: Any) -> Any:
    """Return what the host believes of the driver's queue, and how it speaks to it."""
    return device._stream


def memory_of(core: Any) -> Any:
    """Return the bytes in which the firmware keeps its state, to be read and changed."""
    return core._ffi.buffer(core._memory)
