"""Keep freed array memory in the process instead of giving it back to the kernel each time.

Tables take thousands of operations on arrays of a few 100 kB. glibc returns each temporary to the
kernel and faults the next one in again. On virtual machines those page faults cost 10 to 50 times
the arithmetic. Two raised thresholds of malloc keep the memory.
"""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # from glibc's malloc.h
_MMAP_ABOVE = 32 << 20  # the largest value that glibc takes
_TRIM_ABOVE = 256 << 20


def keep_freed_memory() -> None:
    """Raise the thresholds if the C library is glibc."""
    if sys.platform.startswith("linux"):
        with suppress(AttributeError):  # another C library
            mallopt = ctypes.CDLL(None).mallopt
            mallopt(_M_MMAP_THRESHOLD, _MMAP_ABOVE)
            mallopt(_M_TRIM_THRESHOLD, _TRIM_ABOVE)
