"""How tests wait: until something is so, or for a while.

``HAPTIX_TEST_CLOCK=0.1`` makes each pause of the tests a tenth as long, ``10`` ten times: as on a
machine that is faster or slower. No result may depend on it. What ends a test that hangs is no
pause.
"""

import os
import time
from collections.abc import Callable
from typing import TypeVar

Found = TypeVar("Found")

SCALE = float(os.environ.get("HAPTIX_TEST_CLOCK", "1"))
PATIENCE_S = 240.0 * max(1.0, SCALE)
"""After which a test hangs; two cores that others use too load torch in 20 s."""


def pause(seconds: float) -> None:
    """Let time pass."""
    time.sleep(SCALE * seconds)


def wait_for(is_so: Callable[[], Found | None], seconds: float = PATIENCE_S) -> Found:
    """Wait until something is so, and return it; after `seconds` it hangs."""
    end_s = time.monotonic() + seconds
    while not (found := is_so()):
        assert time.monotonic() < end_s, f"it did not happen in {seconds:g} s"
        time.sleep(0.002)
    return found
