"""Parts of the error: the drive with each source of error switched off."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from haptix.checks import Array
from haptix.friction import ContactModel
from haptix.render import DirectWave
from haptix.simulation.played import Played
from haptix.status import Status
from haptix.virtual_finger import Felt, VirtualFinger

PARTS: Mapping[str, str] = {
    "finger": "what no drive can change: the finger's own response smooths friction along its path",
    "surface": "interpolation of the friction surface, against the contact model itself",
    "modulation": "the wave on the device's clock: against an ideal carrier of its amplitude; of a "
    "direct drive, friction over a period and the finger's response, against the target",
    "quantisation": "the device's 16 bits, against real numbers",
    "prediction": "touches at the panel's rate, noise and latency, against the true path",
}
"""Sources of error. All that a direct drive does to the finger is in its modulation."""

# Of the secant: 1/mu is nearly linear in V^2, and the surface's amplitude is near to begin with.
_ITERATIONS = 5


def felt_in_steps(known: Played, finger: VirtualFinger, h0_m: float) -> dict[str, Felt]:
    """Return what the finger feels with one source of error of `PARTS` after the other.

    `known` has played the true path and kept its blocks: "prediction" is not among the sources.
    """
    renderer, path = known.renderer, known.setting.path
    rate, drive = renderer.sample_rate_hz, renderer.drive
    step = renderer.blocks[0].step
    sent = known.collected("amplitude_v")
    exact = _without_surface(known, sent, h0_m)
    with_surface = known.feel(finger, known.collected("drive_v"))
    quantised = known.feel(finger)
    if isinstance(drive, DirectWave):
        points = np.arange(len(exact) + 1) * step
        line = np.interp(np.arange(points[-1]), points, np.append(0.0, exact))
        limit = known.setting.model.screen.max_voltage_v
        ideal = known.feel(finger, drive.modulate(line, 0, rate).clip(-limit, limit))
        return {"modulation": ideal, "surface": with_surface, "quantisation": quantised}

    def feel_ideal(amplitude_v: Array) -> Felt:
        along = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
        start_s = known.start_s + step / rate
        return finger.feel_carrier(amplitude_v, rate / step, drive.frequency_hz, *along, start_s)

    return {
        "finger": feel_ideal(exact),
        "surface": feel_ideal(sent),
        "modulation": with_surface,
        "quantisation": quantised,
    }


def _without_surface(known: Played, sent_v: Array, h0_m: float) -> Array:
    """Amplitudes by which the model gives the friction that the surface gives by `sent_v`."""
    renderer, model = known.renderer, known.setting.model
    at_s = known.start_s + known.collected("sample") / renderer.sample_rate_hz
    force = known.setting.path.at(at_s)[2]
    found = renderer.surface.evaluate(torch.from_numpy(force), torch.from_numpy(sent_v))
    can_mend = (found.status.cpu().numpy() == Status.OK) & (sent_v > 0)
    exact = sent_v.copy()
    if can_mend.any():
        has_frequency = not renderer.surface.frequency_hz.is_absent
        exact[can_mend] = exact_amplitude(
            model,
            found.mu.cpu().numpy()[can_mend],
            force[can_mend],
            renderer.drive.frequency_hz if has_frequency else None,
            h0_m,
            sent_v[can_mend],
        )
    return exact.clip(max=model.screen.max_voltage_v)


def exact_amplitude(
    model: ContactModel,
    mu: Array,
    normal_force_n: Array,
    frequency_hz: float | None,
    h0_m: float,
    near_v: Array,
) -> Array:
    """Amplitudes [V] by which the contact model gives `mu`, which is above that without voltage.

    By the secant method from amplitudes `near_v`; arrays have the shape (points,).
    """
    force, goal = torch.from_numpy(normal_force_n), torch.from_numpy(1 / mu)
    most = model.screen.max_voltage_v**2

    def miss(square: Tensor) -> Tensor:
        return 1 / model.solve(force, square.sqrt(), frequency_hz, h0_m).mu.cpu() - goal

    before = torch.from_numpy(near_v**2).clamp(1e-6, most)
    square = (before * 0.999).clamp(min=1e-6)
    miss_before, miss_now = miss(before), miss(square)
    for _ in range(_ITERATIONS):
        slope = (miss_now - miss_before) / (square - before)
        step = torch.where(slope < 0, -miss_now / slope, 0.0)
        before, miss_before = square, miss_now
        # A converged point would divide 0 by 0.
        square = torch.where(miss_now.abs() > 1e-13 * goal, square + step, square * (1 - 1e-12))
        square = square.clamp(1e-6, most)
        miss_now = miss(square)
    return np.asarray(square.sqrt().numpy())
