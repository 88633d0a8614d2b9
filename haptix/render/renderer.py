"""The renderer: from touches on a texture to samples on a device."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt
import torch

from firmware_io import Device
from haptix.errors import InputError, LimitError, check_positive
from haptix.render.modulation import Carrier
from haptix.status import Status
from haptix.surface import FrictionSurface
from haptix.texture import Texture

Array = npt.NDArray[np.float64]

DEFAULT_CARRIER_HZ = 4000.0
"""Above what skin feels, and a whole twelfth of the usual 48 kHz."""


@dataclass(frozen=True)
class RenderedBlock:
    """What was wanted and what was sent; arrays of shape (samples,)."""

    first_sample: int
    target_mu: Array
    amplitude_v: Array
    status: npt.NDArray[np.int64]


@dataclass
class RenderStats:
    """Counts and times since the renderer was entered."""

    samples: int = 0
    below: int = 0
    """Samples whose friction was below what the contact has without voltage."""
    above: int = 0
    """Samples whose friction was above what the highest voltage gives."""
    outside: int = 0
    """Samples outside the surface's range of force."""
    block_s: list[float] = field(default_factory=list)
    """Time to compute and send each block [s]."""


class Renderer:
    """Renders a texture under one finger, touch by touch.

    Between two touches place and force are linear, so the signal lags one touch interval behind
    the finger. Leaving the context ends at 0 V; leave it while no finger touches, since a driver
    whose host falls silent takes itself to 0 V and has to be armed again.

    Parameters
    ----------
    surface : FrictionSurface
        Must hold the carrier's frequency and the thickness.
    texture : Texture
        What to feel.
    device : Device
        Where the samples go; its ceiling is lowered to the surface's voltage limit, and must not
        be below it.
    carrier_hz : float, optional
        Frequency of the drive. Without it the surface's own, or where that spans several or leaves
        frequency out, the one nearest to `DEFAULT_CARRIER_HZ`.
    h0_m : float, optional
        Effective insulator thickness, where the surface spans several; the screen's own without.
    block_s : float
        Longest block.
    keep_blocks : bool
        Keep every `RenderedBlock` in `blocks`, for figures and tests.
    """

    def __init__(
        self,
        surface: FrictionSurface,
        texture: Texture,
        device: Device,
        carrier_hz: float | None = None,
        h0_m: float | None = None,
        block_s: float = 0.005,
        keep_blocks: bool = False,
    ) -> None:
        frequency = surface.frequency_hz
        if carrier_hz is None:
            carrier_hz = DEFAULT_CARRIER_HZ
            if not frequency.is_absent:
                carrier_hz = min(max(carrier_hz, frequency.low), frequency.high)
        if surface.h0_m.varies and h0_m is None:
            h0_m = surface.info.get("screen_h0_m")
            if h0_m is None:
                raise InputError("h0_m: the surface spans several; say which the screen has")
        self._surface = surface.at(None if frequency.is_absent else carrier_hz, h0_m)
        self.texture = texture
        self.device = device
        self.carrier = Carrier(carrier_hz, device.capabilities.sample_rate_hz)
        self.stats = RenderStats()
        self.blocks: list[RenderedBlock] = []
        self._keep_blocks = keep_blocks
        check_positive("block_s", block_s)
        self._block = max(1, round(block_s * self.carrier.sample_rate_hz))
        self._touch: tuple[float, float, float, float] | None = None
        self._start_s = 0.0
        self._next_sample = 0

    def __enter__(self) -> Self:
        limit, ceiling = self._surface.voltage_limit_v, self.device.limits.ceiling_v
        if limit > ceiling:
            raise LimitError(
                f"the surface asks for up to {limit:g} V, but the device allows {ceiling:g} V; "
                f"build the surface for voltages up to {ceiling:g} V, or open the device anew if "
                "an earlier surface has lowered its ceiling"
            )
        if limit < ceiling:
            self.device.lower_ceiling(limit)
        self.device.arm()
        self.stats = RenderStats()
        self.blocks = []
        self._touch = None
        self._next_sample = 0
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.device.__exit__(kind, error, traceback)

    def touch(self, t_s: float, x_mm: float, y_mm: float, normal_force_n: float) -> None:
        """Take a touch, and render up to its time.

        Parameters
        ----------
        t_s : float
            Time of the touch [s], later than the one before.
        x_mm, y_mm : float
            Place on the screen.
        normal_force_n : float
            Normal force [N], above 0.

        Raises
        ------
        InputError
            If a value is not finite, the force is not above 0 or the time does not advance.
        LimitError, DeviceError
            If the device rejects the samples or fails; its output is then at 0 V.
        """
        try:
            touch = (float(t_s), float(x_mm), float(y_mm), float(normal_force_n))
        except (TypeError, ValueError):
            raise InputError(
                f"touch: expected four numbers, got {(t_s, x_mm, y_mm, normal_force_n)!r}"
            ) from None
        if not np.isfinite(touch).all() or touch[3] <= 0:
            raise InputError(
                "touch: expected finite t_s, x_mm, y_mm and a normal_force_n above 0, "
                f"got {', '.join(f'{value:g}' for value in touch)}"
            )
        if self._touch is None:
            self._touch, self._start_s = touch, touch[0]
            return
        if touch[0] <= self._touch[0]:
            raise InputError(
                f"touch: time must advance, but {touch[0]:g} s follows {self._touch[0]:g} s"
            )
        # Clocks that count from 1970 resolve a few 1e-7 s: that must not cost a sample.
        end = int((touch[0] - self._start_s) * self.carrier.sample_rate_hz + 0.02)
        while self._next_sample < end:
            self._render(self._touch, touch, min(self._block, end - self._next_sample))
        self._touch = touch

    def _render(self, old: tuple[float, ...], new: tuple[float, ...], count: int) -> None:
        began = time.perf_counter()
        first = self._next_sample
        t = self._start_s + np.arange(first, first + count) / self.carrier.sample_rate_hz
        part = (t - old[0]) / (new[0] - old[0])
        x, y, force = (a + part * (b - a) for a, b in zip(old[1:], new[1:], strict=True))
        target, amplitude, status = self._invert(self.texture.friction(x, y), force)
        self.device.write(self.carrier.modulate(amplitude, first))
        self._next_sample += count
        stats = self.stats
        stats.samples += count
        stats.below += int((status == Status.BELOW).sum())
        stats.above += int(((status == Status.ABOVE) | (status == Status.PULL_IN)).sum())
        stats.outside += int((status == Status.OUT_OF_RANGE).sum())
        stats.block_s.append(time.perf_counter() - began)
        if self._keep_blocks:
            self.blocks.append(RenderedBlock(first, target, amplitude, status))

    def _invert(self, wanted: Array, force: Array) -> tuple[Array, Array, npt.NDArray[np.int64]]:
        """Target mu, amplitude and status for the texture's wish at each sample's force."""
        load = torch.from_numpy(force)
        target = torch.from_numpy(wanted)
        if self.texture.mu_range is None:
            low, high = self._surface.reachable(load)
            target = low + target * (high - low)
        found = self._surface.voltage(target, load)
        return target.numpy(), found.voltage_v.numpy(), found.status.numpy()
