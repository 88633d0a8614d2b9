"""`open_device` of `firmware_io` for ``haptix/__init__.pyi``, which can only name own modules."""

from firmware_io import open_device

__all__ = ["open_device"]
