"""A block in numpy, step by step, as an oracle of the one in C."""

from __future__ import annotations

from typing import Any

import numpy as np

from haptix import Status
from haptix.feel.materials import FrictionField, as_mu
from haptix.play.render import RenderCore

JOIN_S = 0.002
SLACK = 1e-9


class Given(FrictionField):
    """Answers with what it is given."""

    outside = 0.0

    def __init__(self, target, value):
        self._target, self._value = target, value

    @property
    def target(self):
        return self._target

    def _sample(self, x_mm, y_mm, footprint_mm):
        raise NotImplementedError

    def wanted(self, motion):
        return self._value


def interpolated(table: np.ndarray, log_nodes: np.ndarray, log_force: float) -> np.ndarray:
    """Blend the columns of a slice at one force."""
    return np.array([np.interp(log_force, log_nodes, row) for row in table.T])


def inverted(slice_: Any, force_n: float, ask: Any) -> tuple[float, float, int]:
    """Return amplitude, friction and status; `ask` makes friction of a reachable range."""
    column = interpolated(slice_.columns, np.log(slice_.force_n), np.log(force_n))
    inverse, (pull_in_v, breakdown_v) = column[:-2], slice_.unit_v * np.exp(column[-2:])
    if not slice_.limited_by:
        breakdown_v = np.inf
    end = (min(breakdown_v, slice_.limit_v) / pull_in_v) ** 2
    end = min(end, slice_.drive[-1])
    lowest, highest = -1 / inverse[0], -1 / np.interp(end, slice_.drive, inverse)
    mu = ask(lowest, highest)
    drive = np.interp(-1 / max(mu, 1e-150), inverse, slice_.drive)
    end_v = min(pull_in_v * np.sqrt(end), slice_.limit_v)
    status = Status.OK
    if -1 / mu < -(1 + SLACK) / lowest or mu <= 0:
        status = Status.BELOW
    elif -1 / mu > (SLACK - 1) / highest:
        status = Status.ABOVE
        if end >= slice_.pull_in_drive * (1 - 1e-6):
            status = Status.PULL_IN
        if breakdown_v <= end_v * (1 + 1e-6) and breakdown_v < slice_.limit_v:
            status = slice_.limited_by
    if not slice_.force_n[0] * (1 - 1e-6) <= force_n <= slice_.force_n[-1] * (1 + 1e-6):
        status = Status.OUT_OF_RANGE
    return min(pull_in_v * np.sqrt(min(drive, end)), end_v), mu, status


def asked(core: RenderCore, value: float, added: float, intensity: float) -> Any:
    """Return what makes friction of a reachable range."""
    kind, span = core.texture.evaluator.target, core.settings.compress

    def ask(lowest: float, highest: float) -> float:
        mu = as_mu(kind, value, lowest, highest)
        if span is not None and kind != "share":
            bottom, top = (as_mu(kind, edge, lowest, highest) for edge in span)
            low, high = max(bottom, lowest), min(top, highest)
            mu = low + (mu - bottom) / (top - bottom) * max(high - low, 0.0)
        if added:
            mu = min(mu + added * (highest - lowest), max(mu, highest))
        return float(lowest + intensity * (mu - lowest))

    return ask


def slewed(line: np.ndarray, most: float) -> np.ndarray:
    line = line.copy()
    for i in range(1, len(line)):
        line[i] = np.clip(line[i], line[i - 1] - most, line[i - 1] + most)
    return line


def block(
    core: RenderCore, fingers: Any, value: np.ndarray, added: np.ndarray, intensity: np.ndarray,
    first_sample: int, before_v: float, queued_v: np.ndarray | None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Render a block of a material's answers."""
    motion = fingers.motion
    shape = (motion.fingers, motion.points)
    force = motion.normal_force_n.reshape(shape)
    found = [
        inverted(core.slice, f, asked(core, v, a, i))
        for f, v, a, i in zip(
            force.ravel(), value, added, np.tile(intensity, motion.fingers), strict=True
        )
    ]
    volts, mu, status = (np.array(column) for column in zip(*found, strict=True))
    each = (volts * fingers.gain).reshape(shape)
    how = core.settings.combination
    together = {"strongest": each.max(axis=0), "first": each[0], "mean": each.mean(axis=0)}[how]
    line = np.concatenate([[before_v], np.minimum(together, core.highest_v)])
    most = core.most_step_v
    if queued_v is not None:
        joined = min(len(queued_v), round(JOIN_S / core.step_s))
        share = np.arange(1, joined + 1) / joined
        line[-joined:] += share * (queued_v[-joined:] - line[-joined:])
        line = slewed(line, most)
        reach = most * np.arange(motion.points - 1, -1, -1)
        line[1:] = np.clip(line[1:], queued_v[-1] - reach, queued_v[-1] + reach)
    line = slewed(line, most)
    at = np.arange(motion.points * core.step) / core.step
    amplitude = np.interp(at, np.arange(len(line)), line)
    drive = core.drive.modulate(amplitude, first_sample, core.sample_rate_hz)
    return {"target_mu": mu, "status": status, "amplitude_v": line[1:], "drive_v": drive}
