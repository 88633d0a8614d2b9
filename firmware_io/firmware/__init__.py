"""The device side of the protocol: portable C99 firmware, and the class that calls it."""
