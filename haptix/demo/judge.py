"""Judge a stroke by what the driver played, with the contact model itself."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from firmware_io.mock import MockDriver
from haptix.friction import ContactModel
from haptix.motion import Trajectory
from haptix.perception import WEBER_FRACTION
from haptix.render import Renderer
from haptix.status import Status
from haptix.surface import FrictionSurface

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Outcome:
    """Friction along the path, at the middle of every carrier period; arrays (periods,)."""

    t_s: Array
    target_mu: Array
    """What the renderer was to reach."""
    reached_mu: Array
    """What the amplitude that was played gives, by the contact model."""
    amplitude_v: Array
    lowest_mu: Array
    highest_mu: Array
    """Range that the surface can reach at the finger's force."""
    is_reachable: npt.NDArray[np.bool_]
    """Whether the target lies in that range, and the finger slides and is given all of it."""


def judge(
    model: ContactModel,
    surface: FrictionSurface,
    path: Trajectory,
    renderer: Renderer,
    driver: MockDriver,
) -> Outcome:
    """Demodulate what was played and solve the contact for it.

    Surface, inversion, modulation and the driver's 16 bits are all in the difference from the
    target. The renderer must have kept its blocks.
    """
    carrier, rate = renderer.drive, renderer.sample_rate_hz
    sample, amplitude = carrier.demodulate(driver.played_v[: renderer.stats.samples], rate)
    # Rounding to 16 bits may read back a millivolt beyond these.
    amplitude = amplitude.clip(0.0, model.screen.max_voltage_v)
    t = path.t_s[0] + sample / rate
    load = torch.from_numpy(path.at(t)[2])
    reached = model.solve(load, torch.from_numpy(amplitude), carrier.frequency_hz)
    lowest, highest = surface.reachable(load)
    # The middle of a period may lie between two control points: both count.
    at, wanted, status, gain = (
        np.concatenate([getattr(block, name) for block in renderer.blocks])
        for name in ("sample", "target_mu", "status", "gain")
    )
    target = np.interp(sample, at, wanted)
    fed = (status == int(Status.OK)) & (gain == 1.0)
    after = np.searchsorted(at, sample).clip(1, len(at) - 1)
    reachable = fed[after - 1] & fed[after]
    return Outcome(
        t_s=t,
        target_mu=target,
        reached_mu=reached.mu.numpy(),
        amplitude_v=amplitude,
        lowest_mu=lowest.numpy(),
        highest_mu=highest.numpy(),
        is_reachable=reachable,
    )


def friction_figures(outcome: Outcome) -> dict[str, Any]:
    """Error of the reached friction where the target can be reached; None where none can."""
    judged = outcome.is_reachable
    figures: dict[str, Any] = {
        "target_mu_min": float(outcome.target_mu.min()),
        "target_mu_max": float(outcome.target_mu.max()),
        "share_judged": float(judged.mean()),
    }
    names = ("error_rms_mu", "error_p95_mu", "error_max_mu", "error_p95_difference_thresholds")
    if not judged.any():
        return figures | dict.fromkeys(names)
    error = np.abs(outcome.reached_mu - outcome.target_mu)[judged]
    felt = error / (WEBER_FRACTION * outcome.target_mu[judged])
    values = (
        sqrt(float(np.mean(error**2))),
        float(np.percentile(error, 95)),
        float(error.max()),
        float(np.percentile(felt, 95)),
    )
    return figures | dict(zip(names, values, strict=True))
