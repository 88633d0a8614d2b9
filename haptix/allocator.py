"""Keep freed array memory in the process instead of giving it back to the kernel each time.

The tables are made by thousands of operations on arrays of a few 100 kB. glibc returns each such
temporary to the kernel and faults it in again for the next one; on virtual machines those page
faults cost 10 to 50 times the arithmetic. Raising two of malloc's thresholds keeps them.
"""

from __future__ import annotations

import ctypes
import sys

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # from glibc's malloc.h
_MMAP_ABOVE = 32 << 20  # the largest value that glibc takes
_TRIM_ABOVE = 256 << 20


def keep_freed_memory() -> bool:
    """Raise the thresholds where the C library is glibc; say whether that was done."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except AttributeError:
        return False
    return bool(mallopt(_M_MMAP_THRESHOLD, _MMAP_ABOVE) and mallopt(_M_TRIM_THRESHOLD, _TRIM_ABOVE))
