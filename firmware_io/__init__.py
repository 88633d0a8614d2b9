"""Voltages to electrovibration screens: frames, links, limits.

`open_device` turns an address into a `Device`; a device, used in a with statement, takes
voltages and always ends at 0 V::

    with firmware_io.open_device("mock:") as device:
        device.write(volts)

In real time `Playback` plays through a device from a thread of its own. Every sample passes the
limits of limits.py on the host and those of the driver behind the wire. The package handles volts
and samples and knows no physics. A new kind of hardware is a new `Link`. PROTOCOL.md describes the
wire format. The public names stand in ``__init__.pyi`` and load on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
