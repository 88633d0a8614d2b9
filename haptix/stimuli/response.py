"""What a voltage does to friction, at one force, frequency and thickness: of one finger or many.

A friction surface holds ``-1/mu`` against ``s = (V0 / V_unit)^2`` along each column and blends
columns linearly. At one force the blend is made once; what is left, both ways, is one interpolation
per sample, exact on the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError, RangeError
from haptix.status import Status
from haptix.surface import FrictionSurface

Array = npt.NDArray[np.float64]

_DENSE = 4097  # nodes where fingers are combined, whose curves cross anywhere


@dataclass(frozen=True, eq=False)
class Response:
    """Friction against the drive's amplitude.

    Parameters
    ----------
    share : ndarray, shape (nodes,)
        ``s = (V0 / unit_v)^2``, from 0.
    falling : ndarray, shape (nodes,)
        ``-1/mu`` there, not falling; linear in between.
    unit_v : float
        Amplitude at s = 1 [V].
    limit_v : float
        Amplitude at which the response ends [V].
    ends_by : Status
        Why: ABOVE (the voltage limit), PULL_IN or BREAKDOWN.
    """

    share: Array
    falling: Array
    unit_v: float
    limit_v: float
    ends_by: Status

    @classmethod
    def of(
        cls,
        surface: FrictionSurface,
        normal_force_n: float,
        frequency_hz: float | None,
        h0_m: float | None = None,
    ) -> Response:
        """Slice a surface at one force, frequency and thickness.

        Raises
        ------
        InputError, RangeError
            If the place lies outside the surface, or one is missing that the surface spans.
        """
        where = [
            None if axis.is_absent else value
            for axis, value in zip(
                (surface.frequency_hz, surface.h0_m), (frequency_hz, h0_m), strict=True
            )
        ]
        if surface.h0_m.varies and where[1] is None:
            where[1] = surface.info.get("screen_h0_m")
        if surface.frequency_hz.varies and where[0] is None:
            raise InputError("frequency_hz: the surface spans several; say which the drive has")
        table = surface.at(*where).table
        force = table.axes[0]
        if not bool(force.contains(force.nodes.new_tensor(normal_force_n))):
            raise RangeError(
                f"normal_force_n: {normal_force_n:g} N is outside the surface's "
                f"{force.low:g} to {force.high:g} N; build one for it"
            )
        columns = table.columns[:, 0, 0].double().numpy()
        column = columns[0]
        if force.varies:
            cell, part = force.locate_one(normal_force_n)
            column = columns[cell] + float(part) * (columns[cell + 1] - columns[cell])
        unit = float(table.unit_v * np.exp(column[-2]))
        limit = float(surface.at(*where).highest_voltage(normal_force_n))
        return cls(
            table.drive.double().numpy(),
            np.asarray(column[:-2]),
            unit,
            limit,
            _ends_by(limit, unit, table.voltage_limit_v),
        )

    @classmethod
    def median(cls, responses: Sequence[Response]) -> Response:
        """Median over fingers, up to the lowest of their ends."""
        if len(responses) == 1:
            return responses[0]
        lowest = min(responses, key=lambda one: one.limit_v)
        share = np.linspace(0, 1, _DENSE)
        voltage = lowest.limit_v * np.sqrt(share)
        middle = np.median([-1 / one.mu(voltage) for one in responses], axis=0)
        # A median of rising curves rises; this makes it true of the last bit as well.
        falling = np.maximum.accumulate(middle)
        return cls(share, falling, lowest.limit_v, lowest.limit_v, lowest.ends_by)

    @property
    def lowest_mu(self) -> float:
        """Friction without voltage."""
        return float(-1 / self.falling[0])

    @property
    def highest_mu(self) -> float:
        """Friction at the highest amplitude."""
        return float(self.mu(np.array([self.limit_v]))[0])

    def mu(self, amplitude_v: Array) -> Array:
        """Friction at amplitudes [V]; past the end, that at the end."""
        share = np.square(np.minimum(amplitude_v, self.limit_v) / self.unit_v)
        return np.asarray(-1 / np.interp(share, self.share, self.falling))

    def voltage(self, mu: Array) -> tuple[Array, int, int]:
        """Amplitude [V] for wanted frictions, and how many lie below and above what is reachable.

        Those get the nearest amplitude that there is.
        """
        low, high = self.lowest_mu, self.highest_mu
        slack = 1e-9 * high  # an end's own value is not out of reach by rounding
        below = int(np.count_nonzero(mu < low - slack))
        above = int(np.count_nonzero(mu > high + slack))
        wanted = np.clip(mu, low, high)
        share = np.interp(-1 / wanted, self.falling, self.share)
        return np.minimum(self.unit_v * np.sqrt(share), self.limit_v), below, above


def _ends_by(limit_v: float, unit_v: float, allowed_v: float) -> Status:
    if limit_v >= allowed_v * (1 - 1e-9):
        return Status.ABOVE
    # Surfaces end at 90 % of the pull-in voltage, or before that where something breaks down.
    return Status.PULL_IN if limit_v >= 0.9 * unit_v * (1 - 1e-6) else Status.BREAKDOWN
