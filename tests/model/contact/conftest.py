"""The reference numbers, and a slow mean-field solver written from the equations alone."""

import json
from collections.abc import Callable
from itertools import pairwise
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import special
from scipy.integrate import quad, simpson

Function = Callable[[np.ndarray], np.ndarray]


@pytest.fixture(scope="session")
def reference_cases() -> dict[str, dict[str, Any]]:
    path = Path(__file__).parents[2] / "data" / "meanfield.json"
    return {case["name"]: case for case in json.loads(path.read_text())["cases"]}


class SlowMeanField:
    """Persson's theory in numpy for any spectrum C(q) and modulus E*(q), plain gap distribution.

    Straight from the integrals: tau^2 by the trapezoidal rule on very many waves, J by `quad`, ubar
    by Simpson's rule in ln tau, ``u1 = ubar + A dubar/dA`` by differences along the magnification,
    and I as the integral of ``P(u)/|u + h0|^2`` over the gaps.
    """

    WAVES = 100_001  # dx = 6e-4 in ln(q/q0 - 1): the trapezoidal rule is right to 1e-7
    STRIPS = 601  # per half of the magnifications; doubling it moves I by about 1e-5
    DEPTH = 601  # points of Simpson's rule in ln tau
    GAPS = 500  # nodes of the integral over the gaps

    def __init__(
        self, spectrum: Function, modulus: Function, nodes: list[float], gamma: float = 0.45
    ) -> None:
        q0, q1 = nodes[0], nodes[-1]
        x = np.linspace(np.log(1e-18), np.log(q1 / q0 - 1), self.WAVES)
        kinks = [np.log(q / q0 - 1) for q in nodes[1:-1] if q > q0]
        self.x = np.unique(np.concatenate([x, kinks]))
        ratio = np.exp(self.x)
        # Held within the band: at its last node q0 (1 + ratio) may round to just beyond q1.
        q = np.clip(q0 * (1 + ratio), q0, q1)
        density = np.pi * q**3 * spectrum(q) * modulus(q) ** 2 * q0 * ratio  # d(tau^2)/dx
        cells = (density[1:] + density[:-1]) / 2 * np.diff(self.x)
        self.variance = density[0] + np.concatenate([[0.0], np.cumsum(cells)])
        heights = 2 * np.pi * q * spectrum(q) * q0 * ratio
        cells = (heights[1:] + heights[:-1]) / 2 * np.diff(self.x)
        self.short_waves = np.concatenate([np.cumsum(cells[::-1])[::-1], [0.0]])
        self.log_variance = np.log(self.variance)
        self.log_stiffness = np.log(q * modulus(q))
        self.tau = sqrt(self.variance[-1])
        self.log_y = np.linspace(np.log(1e-7), np.log(6.0), 1501)

        def integrand(t: float) -> float:  # J's integrand with x = e^t
            y = np.exp(t)
            return (gamma + 3 * (1 - gamma) * special.erf(y) ** 2) * np.exp(-y * y)

        cells = [quad(integrand, a, b)[0] for a, b in pairwise(self.log_y)]
        tail = quad(integrand, self.log_y[-1], np.log(9.0))[0]
        self.log_j = np.log(np.cumsum([tail, *cells[::-1]])[::-1])

    def area_fraction(self, pressure: float) -> float:
        return float(special.erf(pressure / self.tau))

    def mean_gap(self, pressure: float) -> float:
        whole = self._separation(np.array([pressure]), np.zeros(1), np.array([self.tau**2]))
        return float(whole[0])

    def _separation(self, pressure: np.ndarray, before: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """ubar where the waves of variance `before` are seen and those of `rest` are not yet."""
        top = np.sqrt(rest)
        low = np.minimum(np.log(pressure / 6.0), np.log(np.maximum(top, 1e-300)))
        span = np.log(np.maximum(top, 1e-300)) - low
        log_tau = low[:, None] + span[:, None] * np.linspace(0, 1, self.DEPTH)
        tau = np.exp(log_tau)
        log_j = np.interp(np.log(pressure)[:, None] - log_tau, self.log_y, self.log_j)
        at = np.log(before[:, None] + tau**2)
        stiffness = np.exp(np.interp(at, self.log_variance, self.log_stiffness))
        integrand = tau * np.exp(log_j) / stiffness
        return 2 / sqrt(np.pi) * simpson(integrand, dx=1 / (self.DEPTH - 1), axis=1) * span

    def inverse_square_gap(self, pressure: float, h0: complex) -> float:
        """I of the open gaps alone."""
        total = self.tau**2
        start = min((pressure / 6.0) ** 2, total / 4)
        # First half of the magnifications graded towards q0, second towards q1.
        early = np.geomspace(start, total / 2, self.STRIPS)
        late = np.geomspace(total / 2, total * 1e-12, self.STRIPS)
        before = np.concatenate([early, total - late[1:]])
        rest = np.concatenate([total - early, late[1:]])
        y = pressure / np.sqrt(before)
        area = special.erf(y)
        ubar = np.concatenate(
            [
                self._separation(p, v, r)
                for p, v, r in zip(
                    np.array_split(pressure / area, 24),
                    np.array_split(before, 24),
                    np.array_split(rest, 24),
                    strict=True,
                )
            ]
        )
        opened = np.where(y[1:] > 0.5, np.diff(special.erfc(y)), -np.diff(area))
        u1 = np.maximum(-np.diff(area * ubar), 0.0) / np.maximum(opened, 1e-300)
        middle = np.concatenate(
            [np.sqrt(early[1:] * early[:-1]), total - (late[1:] + late[:-1]) / 2]
        )
        x = np.interp(np.log(middle), self.log_variance, self.x)
        s = np.sqrt(np.interp(x, self.x, self.short_waves))
        largest = (u1 + 8 * s).max()
        u = np.geomspace(1e-6 * abs(h0), largest, self.GAPS)
        density = np.zeros_like(u)
        for some in np.array_split(np.arange(len(s)), 24):
            peaks = sum(
                np.exp(-(((u[:, None] - side * u1[some]) / s[some]) ** 2) / 2) for side in (1, -1)
            )
            density += (peaks * opened[some] / (sqrt(2 * np.pi) * s[some])).sum(1)
        kernel = 1 / ((u + h0.real) ** 2 + h0.imag**2)
        first = density[0] * u[0] * kernel[0]
        return float(first + simpson(density * kernel * u, x=np.log(u)))


@pytest.fixture(scope="session")
def slow_mean_field() -> type[SlowMeanField]:
    return SlowMeanField
