"""The XML of the Penn Haptic Texture Toolkit, checked.

The root ``modelSet`` holds::

    material, SampleRate [Hz], mu, numMod, numTri, maxSpeed [mm/s], maxForce [N],
    speedList and forceList (each of value ...), tri ... (3 values, vertices from 1),
    numARCoeff, numMACoeff,
    model ...: modNum, ARcoeff, ARlsf, MAcoeff, MAlsf (each of value ...), var, gain, speedMod,
               forceMod
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np
import numpy.typing as npt
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from haptix.checks import Array
from haptix.errors import FileFormatError, InputError
from haptix.files import read_bytes

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
    """Read what is below the root; `ValueError` if it contradicts itself or is not stable."""
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
    for name, own in (("speedList", speed), ("forceList", force)):
        listed = _numbers(root.find(name))
        # Both are printed with six decimals.
        if root.find(name) is not None and not (
            len(listed) == len(own) and np.allclose(listed, own, rtol=0, atol=2e-6)
        ):
            raise ValueError(f"{name}: expected those of the models in their order")
    rate, mu = _number(root, "SampleRate"), _number(root, "mu")
    variance = np.array([_number(model, "var") for model in models])
    if not (rate > 0 and mu >= 0 and (variance >= 0).all()):
        raise ValueError("expected a SampleRate above 0 and mu and var of 0 or more")
    # A pure autoregression has no gain, whatever is written.
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
    """Line spectral frequencies as the file gives them, or from the coefficients."""
    if order == 0:
        return np.empty(0)
    given = model.find(f"{kind}lsf")
    if given is not None and len(_numbers(given)):
        lsf = _numbers(given)
    else:
        lsf = lsf_of_polynomial(_numbers(model.find(f"{kind}coeff")))
    if len(lsf) != order:
        raise ValueError(f"{kind}lsf: expected {order} numbers in each model, got {len(lsf)}")
    if not (lsf[0] > 0 and lsf[-1] < pi and (np.diff(lsf) > 0).all()):
        raise ValueError(f"{kind}lsf: expected frequencies that increase between 0 and pi")
    return lsf


def _triangles(root: ET.Element, speed: Array, force: Array) -> npt.NDArray[np.intp]:
    listed = [_numbers(one) for one in root.findall("tri")]
    if not listed:
        from scipy.spatial import Delaunay

        points = np.column_stack([speed, force])
        try:
            return np.asarray(Delaunay(points / np.ptp(points, axis=0)).simplices, dtype=np.intp)
        except Exception:  # qhull has errors of its own
            raise ValueError("expected models that are not all in one line") from None
    if int(_number(root, "numTri", len(listed))) != len(listed):
        raise ValueError(f"tri: expected numTri triangles, got {len(listed)}")
    if any(len(one) != 3 for one in listed):
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
