"""The device side of the protocol: portable C99 firmware, and its twin in Python.

`open_core` returns whichever can run here; both have the same face and play the same samples.
"""
