"""What a renderer counts and times."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from haptix.render.core import RenderedBlock
from haptix.status import Status

_KEPT = 100_000


@dataclass
class RenderStats:
    """Counts and times since the renderer was entered."""

    samples: int = 0
    """Samples rendered."""
    below: int = 0
    """Samples, of all fingers, whose target was below the friction without voltage."""
    above: int = 0
    """Samples whose target was above what the highest voltage, pull-in or breakdown allow."""
    outside: int = 0
    """Samples whose force was outside the surface's range."""
    block_s: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT))
    """Time to compute each of the last blocks [s]."""
    lead_s: float = 0.0
    """Time from computing a sample to playing it, as set; 0 in virtual time."""
    underruns: int = 0
    """Times that samples ran out."""
    late_blocks: int = 0
    """Blocks that arrived after samples had run out."""
    touch_age_s: float = 0.0
    """Time from the newest touch to the start of the last block [s]."""

    def add(self, block: RenderedBlock, seconds: float) -> None:
        """Count a block."""
        self.samples += len(block.drive_v)
        self.block_s.append(seconds)
        if block.status.any():
            each = np.bincount(block.status.ravel(), minlength=len(Status)) * block.step
            self.below += int(each[Status.BELOW])
            self.above += int(each[Status.ABOVE] + each[Status.PULL_IN] + each[Status.BREAKDOWN])
            self.outside += int(each[Status.OUT_OF_RANGE])

    @property
    def p50_block_s(self) -> float:
        """Median time to compute a block [s]; nan without blocks."""
        return self._percentile(50)

    @property
    def p99_block_s(self) -> float:
        """99th percentile of it [s]."""
        return self._percentile(99)

    @property
    def max_block_s(self) -> float:
        """Longest time [s]."""
        return self._percentile(100)

    def _percentile(self, percent: float) -> float:
        times = list(self.block_s)
        return float(np.percentile(times, percent)) if times else float("nan")
