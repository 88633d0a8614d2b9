"""The device side of the protocol: portable C99 firmware, and its reference in Python.

`firmware_io.firmware.opening.open_core` returns one of them; both have the same interface and play
the same samples.
"""
