"""Memory that a solve needs, compared with what is free before it starts."""

from __future__ import annotations

import os
from pathlib import Path

import torch

from haptix.errors import InputError

# Doubles per point at the peak: 12 fields of the descent, 6 of transforms and their temporaries,
# and as many again of Anderson's mixing and the gap distribution. At 512 and 1024 points the
# process grew by 22 and by 44 doubles per point.
CONTACT_FIELDS = 24
ATTRACTION_FIELDS = 24


def estimated_bytes(points: int, surfaces: int, coupled: bool = False) -> int:
    """Bytes at the peak for `surfaces` solved at a time on `points` x `points` pixels."""
    fields = CONTACT_FIELDS + (ATTRACTION_FIELDS if coupled else 0)
    return 8 * fields * points**2 * surfaces


def free_bytes(device: torch.device) -> int | None:
    """Bytes free on the device, or None where the system does not say."""
    if device.type == "cuda":
        return int(torch.cuda.mem_get_info(device)[0])
    try:
        with Path("/proc/meminfo").open(encoding="ascii") as lines:
            for line in lines:
                if line.startswith("MemAvailable:"):
                    return int(line.split()[1]) * 1024
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, AttributeError):
        return None


def check_memory(points: int, surfaces: int, coupled: bool, device: torch.device) -> None:
    """Raise `InputError` where the estimate is above what is free."""
    needed, free = estimated_bytes(points, surfaces, coupled), free_bytes(device)
    if free is not None and needed > free:
        raise InputError(
            f"expected a solve that fits into the {free / 2**30:.3g} GiB free on {device}, got one "
            f"of about {needed / 2**30:.3g} GiB ({surfaces} surface(s) of {points} x {points} "
            "pixels at a time); take fewer points or fewer surfaces at a time"
        )


def surfaces_that_fit(points: int, device: torch.device) -> int:
    """Largest batch that leaves half of the free memory alone, at least 1."""
    free = free_bytes(device)
    return 1 if free is None else max(1, free // 2 // estimated_bytes(points, 1))
