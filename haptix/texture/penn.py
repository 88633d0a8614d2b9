"""Texture models in the format of the Penn Haptic Texture Toolkit, as friction.

The toolkit (Culbertson, Lopez Delgado and Kuchenbecker, IEEE Haptics Symposium 2014) models the
acceleration of a tool that is dragged over a material: an autoregressive process for each of many
speeds and normal forces, a Delaunay triangulation over these, and one friction coefficient;
`haptix.texture.penn_file` has the format. Between the vertices of a triangle the line spectral
frequencies, the variance and the gain are linear, which keeps the interpolated process stable.

At one speed v and force F the process has a spectrum over frequency f. A pattern under a finger of
that speed has the same spectrum over wavenumber ``k = f / v``. A mass m turns accelerations into
friction: ``mu(x) = mu + m a(x) / F``.

This has limits. The pattern is right at its one speed and force. At other speeds its frequencies
shift with the speed and its depth stays, while the toolkit's change by the triangulation. The
tool's resonances are part of the pattern. The toolkit folds the acceleration into one direction,
which is here taken as the finger's. A tool is not a finger: this transfers a spectrum, not a
sensation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import pi
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
import numpy.typing as npt
from numpy.polynomial.polynomial import polyval
from pydantic import Field, PositiveFloat

from haptix.checks import Array, positive
from haptix.errors import FileFormatError, InputError
from haptix.kinds import AnyAsset
from haptix.texture.field import TargetKind
from haptix.texture.material import Material
from haptix.texture.noise import Noise
from haptix.texture.penn_file import Contents, contents_of, polynomial_of_lsf, root_of

TOOL_MASS_KG = 0.05
"""Mass that turns the toolkit's accelerations into forces unless another is given: the order of a
hand-held tool with the fingers on it, an assumption and no measurement."""

_PIXELS = 16384
_HEAVY = 1e6


@dataclass(frozen=True)
class ProcessAt:
    """The process at one speed and force: ``y[n] = gain (C * e)[n] - (A[1:] * y)[n]``."""

    speed_mm_per_s: float
    normal_force_n: float
    ar: Array
    """Denominator A, first 1."""
    ma: Array
    """Numerator C, first 1."""
    gain: float
    variance: float
    """Variance of the white noise e [(m/s^2)^2]."""
    sample_rate_hz: float

    def density(self, frequency_hz: npt.ArrayLike) -> Array:
        """One-sided power density of the acceleration [(m/s^2)^2/Hz], 0 above half the rate."""
        f = np.asarray(frequency_hz, dtype=np.float64)
        z = np.exp(-2j * pi * f / self.sample_rate_hz)
        response = polyval(z, self.gain * self.ma) / polyval(z, self.ar)
        power = 2 * self.variance / self.sample_rate_hz * np.abs(response) ** 2
        return np.where(f <= self.sample_rate_hz / 2, power, 0.0)

    @property
    def deviation(self) -> float:
        """Standard deviation of the acceleration [m/s^2]."""
        f = np.linspace(0, self.sample_rate_hz / 2, 1 << 15)
        return float(np.sqrt(np.trapezoid(self.density(f), f)))


@dataclass(frozen=True)
class PennModel:
    """A material of the toolkit; make one by `load`.

    Parameters
    ----------
    contents : Contents
        Contents of its file.
    """

    contents: Contents

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a model's XML.

        Raises
        ------
        FileFormatError
            If the file is missing, is not such XML, contradicts itself or has an unstable model.
        """
        root = root_of(Path(path))
        try:
            return cls(contents_of(root))
        except ValueError as error:
            raise FileFormatError(f"{path}: {error}") from None

    def at(self, speed_mm_per_s: float, normal_force_n: float) -> ProcessAt:
        """Interpolate to a speed and a force; those beyond the models are held at the nearest.

        Raises
        ------
        InputError
            If one is not above 0.
        """
        positive("speed_mm_per_s", speed_mm_per_s)
        positive("normal_force_n", normal_force_n)
        place = np.array([speed_mm_per_s, normal_force_n], dtype=np.float64)
        nodes, weights = self._nearest(place)
        return ProcessAt(
            float(weights @ self.contents.speed_mm_per_s[nodes]),
            float(weights @ self.contents.normal_force_n[nodes]),
            polynomial_of_lsf(weights @ self.contents.ar_lsf[nodes]),
            polynomial_of_lsf(weights @ self.contents.ma_lsf[nodes]),
            float(weights @ self.contents.gain[nodes]),
            float(weights @ self.contents.variance[nodes]),
            self.contents.sample_rate_hz,
        )

    def _nearest(self, place: Array) -> tuple[npt.NDArray[np.intp], Array]:
        """Three models and their weights at the place, or at the nearest place in a triangle."""
        points = np.column_stack([self.contents.speed_mm_per_s, self.contents.normal_force_n])
        scale = np.ptp(points, axis=0)  # nearness must not depend on the units
        points, place = points / scale, place / scale
        found = [(one, _closest_weights(points[one], place)) for one in self.contents.triangles]
        return min(found, key=lambda one: float(np.linalg.norm(one[1] @ points[one[0]] - place)))

    def texture(
        self,
        speed_mm_per_s: float,
        normal_force_n: float,
        mass_kg: float = TOOL_MASS_KG,
        seed: int = 0,
        orientation_deg: float = 0.0,
    ) -> Noise:
        """Friction that gives the model's spectrum to a finger of this speed and force.

        Noise with ridges across `orientation_deg`. A stroke along it has the spectrum, a slanted
        one the stretched spectrum, and one across it none. The module lists further limits.

        Parameters
        ----------
        speed_mm_per_s, normal_force_n : float
            Place in the triangulation; the speed turns frequencies into wavenumbers.
        mass_kg : float
            Turns accelerations into forces.
        seed : int
            Same seed, same noise.
        orientation_deg : float
            Direction of the stroke: 0 to the right, 90 down.

        Returns
        -------
        Noise
            Absolute friction coefficients around the model's `mu`, on a tile of 16384 steps of
            the recording.

        Raises
        ------
        InputError
            If a value is not above 0, or the model does not vibrate there.
        """
        positive("mass_kg", mass_kg)
        process = self.at(speed_mm_per_s, normal_force_n)
        deviation = mass_kg * process.deviation / normal_force_n
        if not deviation > 0:
            raise InputError(
                f"{self.contents.material}: no vibration at {speed_mm_per_s:g} mm/s and "
                f"{normal_force_n:g} N; choose a higher speed or force"
            )
        return Noise(
            spectrum=lambda k: process.density(k * speed_mm_per_s),
            mean=self.contents.mu,
            deviation=deviation,
            target="mu",
            seed=seed,
            tile_mm=_PIXELS * speed_mm_per_s / self.contents.sample_rate_hz,
            pixels=_PIXELS,
            grain="ribbed",
            orientation_deg=orientation_deg,
        )


def _closest_weights(corners: Array, place: Array) -> Array:
    """Barycentric weights of the point of a triangle, shape (3, 2), that is nearest to a place."""
    from scipy.optimize import nnls  # it takes half a second

    # Least squares with weights of 0 or more; the heavy row makes their sum 1.
    weights, _ = nnls(np.vstack([corners.T, np.full(3, _HEAVY)]), np.append(place, _HEAVY))
    return np.asarray(weights / weights.sum())


class Penn(Material):
    """A model of the Penn Haptic Texture Toolkit at one speed and force.

    Parameters
    ----------
    file : str
        XML of the model.
    speed_mm_per_s, normal_force_n : float
        Where the pattern has the model's spectrum.
    mass_kg : float
        Turns accelerations into forces; an assumption.
    seed : int
        Same seed, same pattern.
    orientation_deg : float
        Direction of the stroke.
    """

    kind: Literal["penn"] = "penn"
    target: ClassVar[TargetKind] = "mu"
    file: AnyAsset
    speed_mm_per_s: PositiveFloat = 100.0
    normal_force_n: PositiveFloat = 0.5
    mass_kg: PositiveFloat = TOOL_MASS_KG
    seed: Annotated[int, Field(ge=0)] = 0
    orientation_deg: float = 0.0

    @cached_property
    def evaluator(self) -> Noise:
        """A `Noise`."""
        options = self.model_dump(exclude={"kind", "file"})
        return self.file.shared(options, lambda path: PennModel.load(path).texture(**options))
