"""Surface roughness: an isotropic power spectrum C(q), piecewise a power law."""

from __future__ import annotations

from dataclasses import dataclass
from math import log10, pi
from typing import Any

import numpy as np
import torch
from torch import Tensor

from haptix.base import checks
from haptix.base.display import Displayed
from haptix.base.errors import InputError

_RINGS_PER_DECADE = 10  # over which a measured map's spectrum is averaged


@dataclass(frozen=True)
class RoughnessSpectrum(Displayed):
    """Power spectrum of a randomly rough surface, linear in log-log between its nodes.

    The convention is ``h_rms^2 = 2 pi int q C(q) dq`` and ``slope^2 = 2 pi int q^3 C(q) dq``
    (Persson et al., J. Phys.: Condens. Matter 17, R1 (2005)). Build one with `self_affine`,
    `from_table` or `from_topography`.

    Parameters
    ----------
    wavenumber : Tensor, shape (nodes,)
        Increasing wavenumbers q [1/m]; the first and last bound the spectrum.
    density : Tensor, shape (nodes,)
        C at the nodes [m^4], positive.
    """

    wavenumber: Tensor
    density: Tensor

    @classmethod
    def self_affine(
        cls, h_rms_m: float | Tensor, hurst: float, q0: float, q_rolloff: float, q1: float
    ) -> RoughnessSpectrum:
        """Constant from `q0` to the roll-off, then ``q^(-2(1+H))`` up to `q1`.

        Parameters
        ----------
        h_rms_m : float or Tensor
            Root-mean-square roughness [m].
        hurst : float
            Hurst exponent H, in (0, 1].
        q0, q_rolloff, q1 : float
            Lowest wavenumber, roll-off and highest wavenumber [1/m], ``0 < q0 <= q_rolloff <= q1``.

        Raises
        ------
        InputError
            If a value is outside its range.

        Examples
        --------
        >>> spectrum = RoughnessSpectrum.self_affine(1e-6, hurst=0.8, q0=1e4, q_rolloff=1e5, q1=1e7)
        >>> print(f"{float(spectrum.h_rms_m):.3e} m")
        1.000e-06 m
        """
        for name, value in (("h_rms_m", h_rms_m), ("q0", q0), ("q1", q1), ("hurst", hurst)):
            checks.positive(name, value)
        if hurst > 1:
            raise InputError(f"hurst: expected a Hurst exponent in (0, 1], got {hurst:g}")
        if not q0 <= q_rolloff <= q1 or q0 == q1:
            raise InputError(
                "expected q0 <= q_rolloff <= q1 and q0 < q1 [1/m], "
                f"got {q0:g}, {q_rolloff:g}, {q1:g}"
            )
        nodes = sorted({float(q0), float(q_rolloff), float(q1)})
        q = torch.tensor(nodes, dtype=torch.float64)
        shape = torch.clamp(q / q_rolloff, min=1.0) ** (-2 * (1 + hurst))
        unscaled = cls(q, shape)
        h_rms = torch.as_tensor(h_rms_m, dtype=torch.float64)
        return cls(q, shape * h_rms**2 / unscaled.moment(1))

    @classmethod
    def from_table(cls, q: Any, c: Any) -> RoughnessSpectrum:
        """Take a measured spectrum: wavenumbers [1/m] and C [m^4], array-likes of one length.

        Parameters
        ----------
        q : array-like, shape (n,)
            Wavenumbers [1/m], increasing.
        c : array-like, shape (n,)
            Spectrum C [m^4] at them.

        Raises
        ------
        InputError
            If the table is not one-dimensional, finite, positive and increasing in q.

        Examples
        --------
        >>> measured = RoughnessSpectrum.from_table([1e3, 1e4, 1e5], [1e-19, 1e-20, 1e-23])
        >>> bool(measured.h_rms_m > 0)
        True
        """
        try:
            wavenumber = torch.as_tensor(q, dtype=torch.float64)
            density = torch.as_tensor(c, dtype=torch.float64)
        except (TypeError, ValueError, RuntimeError):
            raise InputError("q and c: expected two tables of numbers") from None
        if wavenumber.ndim != 1 or wavenumber.shape != density.shape or len(wavenumber) < 2:
            raise InputError(
                "expected q and c as two one-dimensional tables of one length (2 or more), "
                f"got shapes {tuple(wavenumber.shape)} and {tuple(density.shape)}"
            )
        rising = (wavenumber > 0).all() & (wavenumber.diff() > 0).all()
        if not bool(rising & wavenumber.isfinite().all()):
            raise InputError("q: expected positive wavenumbers [1/m] in increasing order")
        if not bool((density > 0).all() and density.isfinite().all()):
            raise InputError("c: expected positive finite C(q) [m^4]; drop empty bins first")
        return cls(wavenumber, density)

    @classmethod
    def from_topography(cls, height_m: Any, pixel_m: float | None = None) -> RoughnessSpectrum:
        """Radially averaged spectrum of a measured height map, mean plane removed.

        A Hann window suppresses the jump at the borders of a map that is not periodic. The spectrum
        has no waves outside ``2 pi / side`` to ``pi / pixel_m``; `statement` prints its band.

        Parameters
        ----------
        height_m : array_like, shape (rows, columns), or SurfaceTopography.Topography
            Heights [m]; a topography brings its own unit and pixels.
        pixel_m : float
            Distance between pixels [m]; left out for a topography.

        Raises
        ------
        InputError
            If the map is not finite, too small or flat, or its unit or pixels are not known.

        Examples
        --------
        >>> height_m = torch.randn(64, 64, dtype=torch.float64) * 1e-6
        >>> spectrum = RoughnessSpectrum.from_topography(height_m, pixel_m=1e-5)
        >>> bool(0 < spectrum.h_rms_m < 2e-6)
        True
        """
        if hasattr(height_m, "heights"):
            height_m, pixel_m = _read_topography(height_m, pixel_m)
        if pixel_m is None:
            raise InputError("pixel_m: expected the distance between pixels [m], got None")
        checks.positive("pixel_m", pixel_m)
        height = np.asarray(height_m, dtype=float)
        if height.ndim != 2 or min(height.shape) < 8 or not np.isfinite(height).all():
            raise InputError(
                "height_m: expected a finite map of at least 8 x 8 pixels, "
                f"got shape {height.shape}; fill missing points first"
            )
        if np.ptp(height) == 0:
            raise InputError("height_m: expected some roughness, got a flat map")
        rows, columns = height.shape
        y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
        plane = np.column_stack([x.ravel(), y.ravel(), np.ones(height.size)])
        tilt, *_ = np.linalg.lstsq(plane, height.ravel(), rcond=None)
        window = np.outer(np.hanning(rows), np.hanning(columns))
        window /= np.sqrt((window**2).mean())
        waves = np.fft.fft2((height.ravel() - plane @ tilt).reshape(height.shape) * window)
        side_y, side_x = rows * pixel_m, columns * pixel_m
        density = np.abs(waves) ** 2 / height.size**2 * side_x * side_y / (2 * pi) ** 2
        down, across = np.fft.fftfreq(rows, pixel_m), np.fft.fftfreq(columns, pixel_m)
        q = 2 * pi * np.hypot(down[:, None], across)
        # A little wider than the band: rounding must not leave out the waves at its ends.
        low, high = 2 * pi / min(side_x, side_y) * (1 - 1e-9), pi / pixel_m * (1 + 1e-9)
        edges = np.geomspace(low, high, max(3, round(_RINGS_PER_DECADE * np.log10(high / low))) + 1)
        ring = np.digitize(q, edges)
        rings = [r for r in range(1, len(edges)) if (ring == r).any()]
        centre = [float(np.exp(np.log(q[ring == r]).mean())) for r in rings]
        return cls.from_table(centre, [float(density[ring == r].mean()) for r in rings])

    @property
    def q0(self) -> float:
        """Lowest wavenumber of the spectrum [1/m]."""
        return float(self.wavenumber[0])

    @property
    def q1(self) -> float:
        """Highest wavenumber of the spectrum [1/m]."""
        return float(self.wavenumber[-1])

    @property
    def q_rolloff(self) -> float:
        """Wavenumber [1/m] that contributes most to the mean square: where ``q^2 C`` is highest."""
        q, c = self.wavenumber.detach(), self.density.detach()
        return float(q[(q**2 * c).argmax()])

    @property
    def h_rms_m(self) -> Tensor:
        """Root-mean-square roughness [m].

        Examples
        --------
        >>> rough = RoughnessSpectrum.self_affine(1e-6, 0.8, 1e3, 1e4, 1e6)
        >>> round(float(rough.h_rms_m) * 1e6, 6)
        1.0
        """
        return self.moment(1).sqrt()

    @property
    def slope_rms(self) -> Tensor:
        """Root-mean-square slope (of the gradient's magnitude)."""
        return self.moment(3).sqrt()

    def statement(self) -> str:
        """Describe the band, height and slope in one line."""
        decades = log10(self.q1 / self.q0)
        return (
            f"waves of {self.q0:.3g} to {self.q1:.3g} /m ({decades:.1f} decades), h_rms "
            f"{float(self.h_rms_m.detach()):.3g} m, rms slope {float(self.slope_rms.detach()):.3g}"
        )

    def __call__(self, q: Tensor) -> Tensor:
        """C [m^4] at wavenumbers inside the band, any shape."""
        segment, exponent = self._segment(q)
        return self.density[segment] * (q / self.wavenumber[segment]) ** exponent

    def moment(self, power: int, above: Tensor | None = None) -> Tensor:
        """``2 pi int_q^q1 q'^power C dq'`` in closed form, for each lower limit in `above`.

        ``moment(1, q)`` is the mean square of the roughness above the wavenumber q.

        Parameters
        ----------
        power : int
            Power of the wavenumber: 1 for heights, 3 for slopes.
        above : Tensor, optional
            Lower limits q [1/m], of any shape; all waves if not given.

        Examples
        --------
        >>> rough = RoughnessSpectrum.self_affine(2e-6, hurst=0.8, q0=1e3, q_rolloff=1e4, q1=1e7)
        >>> round(float(rough.moment(1)) ** 0.5 * 1e6, 6)  # the heights' root mean square, in um
        2.0
        """
        q, c = self.wavenumber, self.density
        exponent = torch.log(c[1:] / c[:-1]) / torch.log(q[1:] / q[:-1])
        whole = _power_integral(
            c[:-1] * q[:-1] ** (power + 1), q[1:] / q[:-1], power + 1 + exponent
        )
        tails = torch.cat([whole.flip(0).cumsum(0).flip(0), whole.new_zeros(1)])
        if above is None:
            return 2 * pi * tails[0]
        segment, exponent_here = self._segment(above)
        prefactor = self(above) * above ** (power + 1)
        ratio = q[segment + 1] / above
        rest = _power_integral(prefactor, ratio, power + 1 + exponent_here)
        return 2 * pi * (rest + tails[segment + 1])

    def _segment(self, q: Tensor) -> tuple[Tensor, Tensor]:
        segment = torch.searchsorted(self.wavenumber, q.detach().contiguous(), right=True) - 1
        segment = segment.clamp(0, len(self.wavenumber) - 2)
        rise = torch.log(self.density[segment + 1] / self.density[segment])
        return segment, rise / torch.log(self.wavenumber[segment + 1] / self.wavenumber[segment])


def _read_topography(topography: Any, pixel_m: float | None) -> tuple[Any, float]:
    """Heights [m] and pixel [m] of an object of SurfaceTopography's kind."""
    if pixel_m is not None:
        raise InputError(f"pixel_m: a topography brings its own pixels, got {pixel_m:g} as well")
    if topography.unit is None:
        raise InputError(
            "height_m: expected a topography whose unit is known; give it one, such as unit='um'"
        )
    in_metres = topography.to_unit("m")
    sides = np.unique(np.round(np.asarray(in_metres.pixel_size, dtype=float), 15))
    if len(sides) != 1:
        raise InputError(f"height_m: expected square pixels, got {in_metres.pixel_size} m")
    return np.ma.filled(in_metres.heights(), np.nan), float(in_metres.pixel_size[0])


def _power_integral(value_times_q: Tensor, ratio: Tensor, exponent: Tensor) -> Tensor:
    """``int f dq`` over a segment where ``q f ~ q^exponent``; ``(ratio^e - 1)/e``, stable at 0."""
    span = torch.log(ratio)
    growth = exponent * span
    small = growth.abs() < 1e-6
    safe = torch.where(small, torch.ones_like(growth), growth)
    factor = torch.where(small, 1 + growth / 2, torch.expm1(safe) / safe)
    return value_times_q * span * factor
