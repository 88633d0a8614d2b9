"""What readings say of a finger if the converter errs by so much: an unscented Kalman filter.

Julier and Uhlmann, Proc. IEEE 92, 401 (2004). Its states are `LATENT` and the errors of the
converter: of the panel's baseline, the drift of its gain, and a gain that follows the voltage.
"""

from __future__ import annotations

from math import log, pi

import numpy as np

from haptix.base.checks import Array
from haptix.play.sensing.contact import FORCE, LATENT, SKIN, ContactCurrent
from haptix.play.sensing.panel import PanelBaseline

_PANEL = len(LATENT)  # the states behind the latent ones: the baseline's error [F],
_DRIFT = _PANEL + 1  # its change [F/s],
_PER_V = _PANEL + 2  # and the change of the converter's gain with the amplitude [1/V]
_STATES = _PANEL + 3
_PF = 1e-12
_LEAST = 1e-12 * np.append(np.ones(_PANEL), [_PF**2, _PF**2, 1e-8])
# What no finger of the population draws moves the estimate no further than this many sigma.
_MOST_SURPRISE = 4.0


class FingerFilter:
    """Mean and covariance of a finger's latent numbers under one assumption of the converter.

    Parameters
    ----------
    contact : ContactCurrent
        The model of all fingers on this screen.
    panel : PanelBaseline
        The untouched panel.
    drift_per_s, gain_per_v : float
        Standard deviations of the change of the converter's gain in a second, and with the
        amplitude in a volt.
    force_per_rt_s, skin_per_rt_s, panel_f_per_rt_s : float
        Wander of the logarithms of force and skin, and of the panel, over a second.
    """

    def __init__(
        self,
        contact: ContactCurrent,
        panel: PanelBaseline,
        drift_per_s: float,
        gain_per_v: float,
        force_per_rt_s: float,
        skin_per_rt_s: float,
        panel_f_per_rt_s: float,
    ) -> None:
        self._contact, self._panel = contact, panel
        self._drift_per_s, self._gain_per_v = drift_per_s, gain_per_v
        self._wander = np.zeros(_STATES)
        self._wander[[FORCE, SKIN, _PANEL]] = force_per_rt_s, skin_per_rt_s, panel_f_per_rt_s
        self.log_likelihood = 0.0
        """Of all readings since it began."""
        self.begin(None)

    def begin(self, person: tuple[Array, Array] | None) -> None:
        """Begin from the population, or from the mean and covariance of a person's `LATENT`."""
        prior = self._contact.population.sd
        self.mean = np.zeros(_STATES)
        variance = np.append(prior**2, [0.0, 0.0, self._gain_per_v**2])
        # The fit's own error stands in the form.
        variance[_PANEL - 1] += self._contact.residual["capacitance"] ** 2
        self.covariance = np.diag(variance)
        if person is not None:
            self.mean[:_PANEL], self.covariance[:_PANEL, :_PANEL] = person
        self.log_likelihood = 0.0
        self.touched()

    def touched(self) -> None:
        """Another touch has another force, and the panel was measured anew before it."""
        panel = self._panel
        drift = self._drift_per_s * abs(panel.farads) if panel.is_measured else 0.0
        for which, sds in (
            (FORCE, (self._contact.population.force,)),
            (_PANEL, (0.3 * _PF, panel.sd_f)),
            (_DRIFT, (drift, panel.drift_f_per_s)),
        ):
            self.mean[which] = 0.0
            self.covariance[which, :] = self.covariance[:, which] = 0.0
            self.covariance[which, which] = np.square(sds).sum()
        self._updated_s = panel.t_s

    @property
    def latent(self) -> tuple[Array, Array]:
        """Mean, shape (6,), and covariance, shape (6, 6), of `LATENT`."""
        return self.mean[:_PANEL], self.covariance[:_PANEL, :_PANEL]

    def points(self) -> tuple[Array, Array]:
        """Points of `LATENT`, shape (n, 6), and weights, with the same mean and covariance."""
        points, weight = _sigma_points(self.mean, self.covariance)
        return points[:, :_PANEL], weight

    def measure_force(self, log_force: float, sd: float) -> None:
        """Take ln of a measured force over the population's, and its standard deviation."""
        row = self.covariance[FORCE]
        gain = self.covariance[:, FORCE] / (row[FORCE] + sd**2)
        self.mean = self.mean + gain * (log_force - self.mean[FORCE])
        self.covariance = self.covariance - np.outer(gain, row)

    def go_on(self, t_s: float, otherwise_s: float) -> None:
        """Let time pass until `t_s`, or `otherwise_s` if it is not known since when."""
        step_s = t_s - self._updated_s if self._updated_s < t_s else otherwise_s
        self._updated_s = t_s
        step = np.eye(_STATES)
        step[_PANEL, _DRIFT] = step_s
        self.mean = step @ self.mean
        self.covariance = step @ self.covariance @ step.T + np.diag(self._wander**2) * step_s

    def update(self, measured_f: complex, voltage_v: float, variance_f2: float) -> bool:
        """Take a capacitance; return whether the result is finite.

        Parameters
        ----------
        measured_f : complex
            Of contact and body, without the panel [F].
        voltage_v : float
            Amplitude [V].
        variance_f2 : float
            Of the noise of each part.
        """
        panel, contact = self._panel, self._contact
        points, weight = _sigma_points(self.mean, self.covariance)
        of_finger = contact.capacitance_f(points[:, :_PANEL], voltage_v)
        follows = points[:, _PER_V] * (voltage_v - panel.voltage_v) * abs(panel.farads)
        farads = of_finger + points[:, _PANEL] + follows
        seen = np.column_stack([farads.real, farads.imag])
        expected = weight @ seen
        off = seen - expected
        among = (weight[:, None] * off).T @ off + variance_f2 * np.eye(2)
        across = (weight[:, None] * (points - self.mean)).T @ off
        gain = np.linalg.solve(among, across.T).T
        lack = np.array([measured_f.real, measured_f.imag]) - expected
        surprise = float(lack @ np.linalg.solve(among, lack)) ** 0.5
        kept = min(1.0, _MOST_SURPRISE / max(surprise, 1e-9))
        mean = self.mean + gain @ (lack * kept)
        covariance = self.covariance - gain @ among @ gain.T
        covariance = (covariance + covariance.T) / 2
        covariance[np.diag_indices(_STATES)] = np.maximum(np.diag(covariance), _LEAST)
        density = -(surprise**2) / 2 - log(2 * pi * np.linalg.det(among / _PF**2) ** 0.5)
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            return False
        self.log_likelihood += density
        most = 40 * _PF, 0.2 * abs(panel.farads), 40 * self._gain_per_v
        bound = np.append(4 * contact.population.sd, most)
        self.mean, self.covariance = np.clip(mean, -bound, bound), covariance
        return True


def _sigma_points(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Points, shape (2 n + 1, n), and their weights: the same mean and covariance."""
    n = len(mean)
    scale = np.sqrt(np.maximum(np.diag(covariance), _LEAST))
    whitened = covariance / np.outer(scale, scale)
    root = np.linalg.cholesky(whitened + 1e-9 * np.eye(n)) * scale[:, None]
    spread = np.sqrt(n) * root.T
    points = np.concatenate([mean[None], mean + spread, mean - spread])
    weight = np.full(2 * n + 1, 1 / (2 * n))
    weight[0] = 0.0
    return points, weight
