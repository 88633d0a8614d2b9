"""Texture models in the format of the Penn Haptic Texture Toolkit, as friction.

The toolkit (Culbertson, Lopez Delgado and Kuchenbecker, IEEE Haptics Symposium 2014) models the
acceleration of a tool that is dragged over a material: an autoregressive process for each of many
speeds and normal forces, a Delaunay triangulation over these, and one friction coefficient.
Between the vertices of a triangle the line spectral frequencies, the variance and the gain are
linear, which keeps the interpolated process stable.

At one speed v and force F the process has a spectrum over frequency f. A pattern under a finger of
that speed has the same spectrum over wavenumber ``k = f / v``. A mass m turns accelerations into
friction: ``mu(x) = mu + m a(x) / F``.

This has limits. The pattern is right at one speed and force only. At other speeds its frequencies
shift with the speed and its depth stays the same, while in the toolkit both change by the
triangulation. The pattern contains the tool's resonances. The toolkit combines the acceleration
into one direction, which is taken as the finger's here. A tool is not a finger: this transfers a
spectrum, not a sensation.

In its XML the root ``modelSet`` holds::

    material, SampleRate [Hz], mu, numMod, numTri, maxSpeed [mm/s], maxForce [N],
    speedList and forceList (each of value ...), tri ... (3 values, vertices from 1),
    numARCoeff, numMACoeff,
    model ...: modNum, ARcoeff, ARlsf, MAcoeff, MAlsf (each of value ...), var, gain, speedMod,
               forceMod
"""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cached_property
from math import erfc, pi, sqrt
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
import numpy.typing as npt
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring
from numpy.polynomial.polynomial import polyval
from pydantic import Field, PositiveFloat

from haptix.base.checks import Array, positive
from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import read_bytes
from haptix.base.kinds import AnyAsset
from haptix.feel.materials.field import TargetKind
from haptix.feel.materials.material import Material
from haptix.feel.materials.patterns import NotFeltWarning
from haptix.feel.materials.spectral import Noise

_UNITS = {"AccelUnits": "m/s", "SpeedUnits": "mm/s", "ForceUnits": "N"}


@dataclass(frozen=True)
class Contents:
    """Contents of a file; arrays have a row or number per model."""

    material: str
    sample_rate_hz: float
    mu: float
    """Coulomb friction between the tool and the material."""
    speed_mm_per_s: Array
    normal_force_n: Array
    ar_lsf: Array
    ma_lsf: Array
    """Line spectral frequencies [rad], shape (models, order); of order 0 without a moving average.
    """
    variance: Array
    gain: Array
    triangles: npt.NDArray[np.intp]
    """Vertices from 0, shape (triangles, 3)."""


def root_of(path: Path) -> ET.Element:
    """Return the element ``modelSet`` of a file, or raise `FileFormatError`."""
    text = read_bytes(path)
    try:
        # Entities can be made to grow without bounds; the format has none.
        root: ET.Element = fromstring(text, forbid_dtd=True)
    except DefusedXmlException:
        raise FileFormatError(f"{path}: expected XML without a document type") from None
    except (ET.ParseError, ValueError, LookupError) as error:
        raise FileFormatError(f"{path}: expected XML, got: {error}") from None
    if root.tag != "modelSet":
        raise FileFormatError(f"{path}: expected the root modelSet, got {root.tag}")
    return root


def contents_of(root: ET.Element) -> Contents:
    """Read the elements of the root; `ValueError` if they contradict each other or are unstable."""
    for name, start in _UNITS.items():
        unit = (root.findtext(name) or start).strip()
        if not unit.startswith(start):
            raise ValueError(f"{name}: expected {start}, got {unit!r}")
    models = root.findall("model")
    if len(models) < 3 or len(models) != int(_number(root, "numMod")):
        raise ValueError(f"expected numMod models, 3 or more, got {len(models)}")
    order, ma_order = int(_number(root, "numARCoeff")), int(_number(root, "numMACoeff", 0))
    speed = np.array([_number(model, "speedMod") for model in models])
    force = np.array([_number(model, "forceMod") for model in models])
    for name, of_models in (("speedList", speed), ("forceList", force)):
        listed = _numbers(root.find(name))
        # The file has both with six decimals.
        if root.find(name) is not None and not (
            len(listed) == len(of_models) and np.allclose(listed, of_models, rtol=0, atol=2e-6)
        ):
            raise ValueError(f"{name}: expected those of the models in their order")
    rate, mu = _number(root, "SampleRate"), _number(root, "mu")
    variance = np.array([_number(model, "var") for model in models])
    if not (rate > 0 and mu >= 0 and (variance >= 0).all()):
        raise ValueError("expected a SampleRate above 0 and mu and var of 0 or more")
    # A pure autoregression has no gain, even where the file states one.
    gain = [_number(model, "gain", 1.0) if ma_order else 1.0 for model in models]
    return Contents(
        (root.findtext("material") or "").strip() or "unnamed",
        rate,
        mu,
        speed,
        force,
        np.array([_lsf(model, "AR", order) for model in models]),
        np.array([_lsf(model, "MA", ma_order) for model in models]),
        variance,
        np.array(gain),
        _triangles(root, speed, force),
    )


def _lsf(model: ET.Element, kind: str, order: int) -> Array:
    """Line spectral frequencies from the file, or from the file's coefficients."""
    if order == 0:
        return np.empty(0)
    element = model.find(f"{kind}lsf")
    if element is not None and len(_numbers(element)):
        lsf = _numbers(element)
    else:
        lsf = lsf_of_polynomial(_numbers(model.find(f"{kind}coeff")))
    if len(lsf) != order:
        raise ValueError(f"{kind}lsf: expected {order} numbers in each model, got {len(lsf)}")
    if not (lsf[0] > 0 and lsf[-1] < pi and (np.diff(lsf) > 0).all()):
        raise ValueError(f"{kind}lsf: expected frequencies that increase between 0 and pi")
    return lsf


def _triangles(root: ET.Element, speed: Array, force: Array) -> npt.NDArray[np.intp]:
    listed = [_numbers(triangle) for triangle in root.findall("tri")]
    if not listed:
        from scipy.spatial import Delaunay

        points = np.column_stack([speed, force])
        try:
            return np.asarray(Delaunay(points / np.ptp(points, axis=0)).simplices, dtype=np.intp)
        except Exception:  # qhull raises its own classes of errors
            raise ValueError("expected models that are not all in one line") from None
    if int(_number(root, "numTri", len(listed))) != len(listed):
        raise ValueError(f"tri: expected numTri triangles, got {len(listed)}")
    if any(len(vertices) != 3 for vertices in listed):
        raise ValueError("tri: expected 3 vertices each")
    corners = np.array(listed)
    if (corners != np.round(corners)).any() or corners.min() < 1 or corners.max() > len(speed):
        raise ValueError(f"tri: expected numbers of models, 1 to {len(speed)}")
    if np.ptp(speed) == 0 or np.ptp(force) == 0:
        raise ValueError("expected models at several speeds and forces")
    return corners.astype(np.intp) - 1


def _number(element: ET.Element, name: str, default: float | None = None) -> float:
    text = element.findtext(name)
    if text is None and default is not None:
        return default
    try:
        number = float(text or "")
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise ValueError(f"{name}: expected a number in {element.tag}, got {text!r}")
    return number


def _numbers(element: ET.Element | None) -> Array:
    if element is None:
        return np.empty(0)
    numbers = np.array([float(value.text or "nan") for value in element.findall("value")])
    if not np.isfinite(numbers).all():
        raise ValueError(f"{element.tag}: expected finite numbers")
    return numbers


def polynomial_of_lsf(lsf: npt.ArrayLike) -> Array:
    """Polynomial whose line spectral frequencies [rad] these are, first coefficient 1.

    The frequencies are, in turn, roots on the unit circle of ``P(z) = A(z) + z^-(m+1) A(1/z)`` and
    ``Q(z) = A(z) - z^-(m+1) A(1/z)``; A is half their sum.
    """
    lsf = np.asarray(lsf, dtype=np.float64)
    order = len(lsf)
    sums, differences = _circle(lsf[0::2]), _circle(lsf[1::2])
    # Every such pair also has roots at 1 and -1.
    if order % 2 == 0:
        sums, differences = np.convolve(sums, [1, 1]), np.convolve(differences, [1, -1])
    else:
        differences = np.convolve(differences, [1, 0, -1])
    return np.asarray((sums + differences)[: order + 1] / 2)


def lsf_of_polynomial(polynomial: npt.ArrayLike) -> Array:
    """Line spectral frequencies [rad], of a polynomial with its roots in the unit circle."""
    a = np.asarray(polynomial, dtype=np.float64)
    a = a / a[0]
    if len(a) == 1:
        return np.empty(0)
    if np.abs(np.roots(a)).max() >= 1:
        raise InputError("expected a stable process, got one with a root on or beyond the circle")
    longer, turned = np.append(a, 0.0), np.append(0.0, a[::-1])
    roots = np.concatenate([np.roots(longer + turned), np.roots(longer - turned)])
    angles = np.sort(np.angle(roots))
    # Roots come in pairs; those at 1 and -1 belong to every pair of such polynomials.
    inner = angles[(angles > 1e-9) & (angles < pi - 1e-9)]
    return np.asarray(inner)


def _circle(angles: Array) -> Array:
    polynomial = np.ones(1)
    for angle in angles:
        polynomial = np.convolve(polynomial, [1.0, -2 * np.cos(angle), 1.0])
    return polynomial


TOOL_MASS_KG = 0.05
"""Default of the mass that turns the toolkit's accelerations into forces: of the order of a
hand-held tool with the fingers on it. It is assumed and not measured."""

_PIXELS = 16384
_TOLD_SHARE = 0.01  # of the places, from which on friction below 0 is told
_SPREADS = 3.0  # of the noise below its mean: beyond lie 0.1 % of the places

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
        """Interpolate to a speed and a force; beyond the models, those at the nearest place.

        Parameters
        ----------
        speed_mm_per_s : float
        normal_force_n : float

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
        weighted = [
            (nodes, _closest_weights(points[nodes], place)) for nodes in self.contents.triangles
        ]

        def distance(candidate: tuple[npt.NDArray[np.intp], Array]) -> float:
            nodes, weights = candidate
            return float(np.linalg.norm(weights @ points[nodes] - place))

        return min(weighted, key=distance)

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
        if (below := erfc(self.contents.mu / deviation / sqrt(2)) / 2) > _TOLD_SHARE:
            most_kg = mass_kg * self.contents.mu / deviation / _SPREADS
            warnings.warn(
                f"{self.contents.material}: asks for friction below 0 in {below:.0%} of its places "
                f"(mean {self.contents.mu:.2g}, deviation {deviation:.2g}), where nothing is felt; "
                f"the mass is an assumption: up to {most_kg:.2g} kg it asks for none",
                NotFeltWarning,
                stacklevel=2,
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
    from scipy.optimize import nnls  # here, since it takes half a second to import

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
