"""Textures by their spectrum: noise, recordings in time, a compact model of them, and a distance.

A recording of sliding friction is read against the place along the stroke and divided by its slow
course. The result is relative changes of friction. A finger of speed v feels their energy at the
wavenumber k at the frequency ``f = k v``.

`BANDS_HZ` are nine bands of equal width in ln f between 10 and 1000 Hz. arXiv:2605.23804, of which
we read the abstract only, reports that energies in nine bands predict how real a texture is judged.
The model is our own choice. It has 13 levels at wavenumbers one band apart, from 0.1/mm (10 Hz at
100 mm/s) to 46/mm (about 1000 Hz at 20 mm/s), with straight lines between them over ln k, and at
most four single waves. Phases are random and amplitudes exact, so that a stroke over the whole tile
has the energies of the model without scatter.

The distance is the root mean square difference of the levels in dB over these bands and speeds: the
log spectral distance of speech (Gray and Markel, IEEE Trans. Acoust. Speech Signal Process. 24, 380
(1976)). docs/textures.md says how it was checked.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import sqrt
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, PositiveFloat, field_serializer, model_validator
from pydantic.json_schema import SkipJsonSchema

from haptix.base.checks import Array, number, positive
from haptix.base.errors import FileFormatError, InputError
from haptix.base.fields import LIFTED_BELOW_N
from haptix.base.files import read_csv
from haptix.base.kinds import shared
from haptix.feel.materials.field import FrictionField, Mapped, turned
from haptix.feel.materials.material import Material
from haptix.feel.materials.memory import check_room
from haptix.feel.materials.pyramid import Beyond, Pyramid, pyramid_numbers
from haptix.feel.materials.recording_columns import RecordingColumns
from haptix.feel.motion import Motion
from haptix.feel.motion.block import SLOW_MM_PER_S

BANDS_HZ: Array = np.geomspace(10.0, 1000.0, 10)
"""Ends of the nine bands [Hz], shape (10,)."""

SPEEDS_MM_PER_S = (20.0, 45.0, 100.0)
"""Speeds at which textures are compared."""

_RATIO = float(BANDS_HZ[1] / BANDS_HZ[0])
_LEVELS = 13
_NODES_PER_MM: Array = 0.1 * _RATIO ** np.arange(_LEVELS, dtype=np.float64)
_MOST_WAVES = 4
_PIXELS = 16384
_USUAL_TILE_MM = 64.0
_SILENT_DB = -80.0  # re the friction: a hundredth of a percent of it
_SHORTEST_MM = 10.0  # length of a stretch with one wave of the lowest band
_COURSE_MM = 20.0  # length of the Hann window, which suppresses waves of 0.1/mm
_SPEED_WINDOW_S = 0.02
_FITTED_SPEEDS = 7
_LOST_PERCENT = 0.5  # of a recording that may lie below the lowest friction of the screen

Level = Annotated[float, Field(ge=-120.0, le=20.0)]
Wave = tuple[PositiveFloat, PositiveFloat]


@dataclass(frozen=True)
class Stretch:
    """Relative changes of friction at even places along a stroke in one direction."""

    step_mm: float
    change: Array
    """Friction over its slow course, less 1; shape (places,)."""
    mu: float
    speed_mm_per_s: float
    normal_force_n: float

    @property
    def length_mm(self) -> float:
        """Length [mm]."""
        return self.step_mm * len(self.change)


def stretches(path: str | Path, columns: RecordingColumns | None = None) -> tuple[Stretch, ...]:
    """Read a recording in time: its strokes of 10 mm or more in one direction.

    Raises `FileFormatError` if the file cannot be read, a column is missing or a cell is not a
    number; `InputError` if times do not increase, or no stroke is long enough.

    Parameters
    ----------
    path : path
        CSV with ``t_s``; ``position_mm`` or ``speed_mm_per_s`` along the stroke; and ``mu``, or
        ``tangential_force_n`` and ``normal_force_n``. Other columns are ignored. Where both are
        known the finger must slide at 2 mm/s or more, and press.
    columns : RecordingColumns, optional
        Which column is what, where the file has others.
    """
    if columns is not None:
        at = columns.read(path)
        names = set(at)
    else:
        rows = list(read_csv(path, ("t_s",)))
        names = set(rows[0].cells) if rows else set()
    needed = ({"position_mm", "speed_mm_per_s"}, {"mu", "tangential_force_n"})
    if not all(either & names for either in needed) or not names & {"mu", "normal_force_n"}:
        raise FileFormatError(
            f"{path}: expected columns t_s, position_mm or speed_mm_per_s, and mu or "
            f"tangential_force_n with normal_force_n; got {', '.join(sorted(names)) or 'no rows'}"
        )
    wanted = ("t_s", "position_mm", "speed_mm_per_s", "mu", "tangential_force_n", "normal_force_n")
    if columns is None:
        found = [name for name in wanted if name in names]
        at = {name: np.array([row.number(name) for row in rows]) for name in found}
    if len(at["t_s"]) < 2 or (np.diff(at["t_s"]) <= 0).any():
        raise InputError(f"{path}: expected two rows or more whose t_s increases")
    dt = float(np.median(np.diff(at["t_s"])))
    t = np.arange(at["t_s"][0], at["t_s"][-1], dt)
    even = {name: np.interp(t, at["t_s"], value) for name, value in at.items()}
    force = even.get("normal_force_n", np.ones(len(t)))
    pressed = force >= LIFTED_BELOW_N
    mu = even.get("mu")
    if mu is None:
        mu = np.abs(even["tangential_force_n"]) / np.where(pressed, force, 1.0)
    place = even.get("position_mm")
    if place is None:
        place = np.cumsum(even["speed_mm_per_s"]) * dt
    window = max(1, round(_SPEED_WINDOW_S / dt))
    speed = np.gradient(
        np.convolve(np.pad(place, window, "edge"), np.ones(window) / window, "same")
    )
    speed = speed[window : len(speed) - window] / dt
    slides = np.where(pressed & (np.abs(speed) >= SLOW_MM_PER_S), np.sign(speed), 0.0)
    ends = [0, *(np.flatnonzero(np.diff(slides)) + 1).tolist(), len(t)]
    strokes = []
    for first, last in pairwise(ends):
        if slides[first] == 0 or abs(place[last - 1] - place[first]) < _SHORTEST_MM:
            continue
        part = slice(first, last)
        along = np.maximum.accumulate(slides[first] * (place[part] - place[first]))
        fast = float(np.median(np.abs(speed[part])))
        grid = np.arange(0.0, along[-1], fast * dt)
        strokes.append(
            _stretch(fast * dt, np.interp(grid, along, mu[part]), fast, float(force[part].mean()))
        )
    if not strokes:
        raise InputError(
            f"{path}: expected a stroke of {_SHORTEST_MM:g} mm or more in one direction, at "
            f"{SLOW_MM_PER_S:g} mm/s or faster and {LIFTED_BELOW_N:g} N or more; got none"
        )
    return tuple(strokes)


def _stretch(step_mm: float, mu: Array, speed: float, force: float) -> Stretch:
    """Divide friction by its slow course, which has only waves below the lowest band."""
    half = min(round(_COURSE_MM / 2 / step_mm), (len(mu) - 1) // 2)
    kernel = np.hanning(2 * half + 3)[1:-1]
    longer = np.pad(mu, half, "reflect")
    course = np.convolve(longer, kernel / kernel.sum(), "valid")
    if not (course > 0).all():
        raise InputError("recording: expected friction above 0 in its slow course; remove its zero")
    return Stretch(step_mm, mu / course - 1, float(mu.mean()), speed, force)


def stretch_of(material: Mapped) -> Stretch:
    """Return the wanted friction of a material along x, from 0 to 64 mm.

    Raises `InputError` if its target is a share, which is a change of friction on a known screen
    only.
    """
    evaluator = material.evaluator
    if evaluator.target not in ("mu", "contrast"):
        raise InputError(
            f"material: expected a target of mu or contrast, got {evaluator.target}: a share of "
            "the reachable friction is a change of friction on one screen only"
        )
    step_mm = _USUAL_TILE_MM / _PIXELS
    x = np.arange(_PIXELS) * step_mm
    value = evaluator.wanted(Motion.of(x, 0.0))
    return _stretch(step_mm, value + (evaluator.target == "contrast"), 0.0, 0.0)


class Energies:
    """Energy of relative changes of friction against the wavenumber, over some stretches."""

    def __init__(self, parts: Sequence[Stretch]) -> None:
        self.low_per_mm = 2 / max(part.length_mm for part in parts)
        """Lowest resolved wavenumber [1/mm]: half the width of a Hann window's main lobe."""
        self.high_per_mm = min(0.4 / part.step_mm for part in parts)
        """Highest wavenumber [1/mm] that the samples resolve."""
        self._sums = [(part.length_mm, *_cumulative(part.change, part.step_mm)) for part in parts]

    def between(self, low_per_mm: Array, high_per_mm: Array) -> Array:
        """Mean square between wavenumbers [1/mm]; NaN where it was not recorded."""
        total = np.zeros(np.shape(low_per_mm))
        for length, k, cumulative in self._sums:
            total += length * (
                np.interp(high_per_mm, k, cumulative) - np.interp(low_per_mm, k, cumulative)
            )
        known = (low_per_mm >= self.low_per_mm) & (high_per_mm <= self.high_per_mm)
        return np.where(known, total / sum(length for length, _, _ in self._sums), np.nan)

    def levels_db(self, speed_mm_per_s: float) -> Array:
        """Level of the nine bands at a speed [dB re the friction]; NaN where not recorded."""
        k = BANDS_HZ / speed_mm_per_s
        return decibels(self.between(k[:-1], k[1:]))


def decibels(energy: Array) -> Array:
    """Level of energies [dB], no lower than -80 dB."""
    return np.asarray(10 * np.log10(np.maximum(energy, 10 ** (_SILENT_DB / 10))))


def _cumulative(change: Array, step: float, is_periodic: bool = False) -> tuple[Array, Array]:
    """Ends of a spectrum's lines and the energy below each; periodic, or by a Hann window."""
    size = len(change)
    taper = np.ones(size) if is_periodic else np.hanning(size + 2)[1:-1]
    power = np.abs(np.fft.rfft((change - change.mean()) * taper)) ** 2
    power *= 2 / (size * float(np.sum(taper * taper)))
    spacing = 1 / (size * step)
    ends: Array = spacing * (np.arange(len(power) + 1, dtype=np.float64) - 0.5)
    return ends, np.concatenate([[0.0], np.cumsum(power)])


def band_energies(signal: Array, rate_hz: float, is_periodic: bool = False) -> Array:
    """Mean square of a signal in time in the nine bands, shape (9,); periodic: a whole period."""
    ends, cumulative = _cumulative(signal, 1 / rate_hz, is_periodic)
    return np.asarray(np.diff(np.interp(BANDS_HZ, ends, cumulative)))


def distance_db(
    one: Energies, other: Energies, speeds_mm_per_s: Sequence[float] = SPEEDS_MM_PER_S
) -> float:
    """Log spectral distance of two textures [dB], see the module.

    Raises `InputError` if there is no band that both have.
    """
    apart = np.array([one.levels_db(v) - other.levels_db(v) for v in speeds_mm_per_s])
    if np.isnan(apart).all():
        raise InputError("distance: expected recordings with a band in common at 20 to 100 mm/s")
    return float(np.sqrt(np.nanmean(apart**2)))


class Spectral(FrictionField, Material):
    """Random friction whose spectrum is given by 13 levels and some waves, as from a recording.

    Parameters
    ----------
    mean : float
        Mean, above the friction without voltage.
    level_db : tuple of float
        Levels of the changes [dB], of the whole band around each of 13 wavenumbers, even in their
        logarithm from 0.1 to 46.4 waves per millimetre.
    waves : tuple of (float, float)
        Waves that stand out: period and amplitude of each.
    target : {"contrast", "mu"}
        What mean and changes are: relative changes of friction, or friction coefficients.
    tile_mm : float
        Length after which it repeats.
    seed : int
        Same seed, same pattern.
    orientation_deg : float
        Direction of the stroke: 0 to the right, 90 down.
    """

    kind: Literal["spectral"] = "spectral"
    mean: float = 0.2
    level_db: Annotated[tuple[Level, ...], Field(min_length=_LEVELS, max_length=_LEVELS)] = (
        -36.0,
    ) * _LEVELS
    waves: Annotated[tuple[Wave, ...], Field(max_length=_MOST_WAVES)] = ()
    target: Literal["contrast", "mu"] = "contrast"
    tile_mm: Annotated[float, Field(ge=16.0, le=256.0)] = _USUAL_TILE_MM
    seed: Annotated[int, Field(ge=0)] = 0
    orientation_deg: float = 0.0

    @model_validator(mode="after")
    def _fits_the_tile(self) -> Self:
        for period_mm, _ in self.waves:
            if not 4 * self.tile_mm / _PIXELS <= period_mm <= self.tile_mm:
                raise ValueError(
                    f"expected waves of {4 * self.tile_mm / _PIXELS:g} to {self.tile_mm:g} mm, got "
                    f"{period_mm:g} mm"
                )
        return self

    @property
    def evaluator(self) -> Self:
        """Itself, with its tile computed."""
        _ = self.pyramid
        return self

    @property
    def outside(self) -> float:
        """The mean."""
        return self.mean

    @property
    def line_energies(self) -> Array:
        """Mean square of each line of the tile, at 0, 1, 2, ... waves a tile."""
        energy = _of_levels(np.array(self.level_db), self.tile_mm)
        for period_mm, amplitude in self.waves:
            energy[round(self.tile_mm / period_mm)] += amplitude**2 / 2
        return energy

    @cached_property
    def pyramid(self) -> Pyramid:
        """Its tile."""
        return shared(self.model_dump(exclude={"orientation_deg", "target"}), self._made)

    def _made(self) -> Pyramid:
        energy = self.line_energies
        phase = np.random.default_rng(self.seed).uniform(0, 2 * np.pi, len(energy))
        lines = np.sqrt(energy / 2) * np.exp(1j * phase) * _PIXELS
        tile = self.mean + np.fft.irfft(lines, _PIXELS)
        return Pyramid(tile[None, :], self.tile_mm / _PIXELS, self.mean, "repeat", "hold")

    def _sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        x_mm, y_mm = turned(x_mm, y_mm, self.orientation_deg)
        return self.pyramid.sample(x_mm, y_mm, footprint_mm)


def _of_levels(level_db: Array, tile_mm: float) -> Array:
    """Mean square of each line of a tile, straight between the levels over ln k."""
    k = np.arange(_PIXELS // 2 + 1) / tile_mm
    inside = (k >= _NODES_PER_MM[0] / sqrt(_RATIO)) & (k <= _NODES_PER_MM[-1] * sqrt(_RATIO))
    at = np.log(np.where(inside, k, 1.0))
    level = np.interp(at, np.log(_NODES_PER_MM), level_db)
    # A level is the energy of a whole band, whose width in ln k is ln of the ratio.
    density = 10 ** (level / 10) / (np.log(_RATIO) * np.where(inside, k, 1.0))
    return np.where(inside, density / tile_mm, 0.0)


def fit(recorded: Sequence[Stretch], seed: int = 0) -> Spectral:
    """Fit the compact model to a recording, by the levels of the nine bands at 20 to 100 mm/s.

    A level without a recorded band follows the nearest level that has one.
    """
    from scipy.optimize import least_squares

    energies = Energies(recorded)
    waves = _standing_out(energies)
    tile_mm = _USUAL_TILE_MM
    if waves:
        tile_mm = float(f"{waves[0][0] * round(tile_mm / waves[0][0]):.4g}")
    k = np.array([BANDS_HZ / v for v in np.geomspace(20.0, 100.0, _FITTED_SPEEDS)])
    low, high = k[:, :-1].ravel(), k[:, 1:].ravel()
    wanted = energies.between(low, high)
    known = np.isfinite(wanted)
    low, high, wanted_db = low[known], high[known], decibels(wanted[known])
    spacing = 1 / tile_mm
    ends = spacing * (np.arange(_PIXELS // 2 + 2) - 0.5)
    of_waves = np.zeros(_PIXELS // 2 + 1)
    for period_mm, amplitude in waves:
        of_waves[round(tile_mm / period_mm)] += amplitude**2 / 2

    def miss(level_db: Array) -> Array:
        total = np.concatenate([[0.0], np.cumsum(_of_levels(level_db, tile_mm) + of_waves)])
        model_db = decibels(np.interp(high, ends, total) - np.interp(low, ends, total))
        # The second part lets levels without a recorded band follow their neighbours.
        return np.concatenate([model_db - wanted_db, 0.02 * np.diff(level_db)])

    edges = np.sqrt(_RATIO)
    start = decibels(np.nan_to_num(energies.between(_NODES_PER_MM / edges, _NODES_PER_MM * edges)))
    solution = least_squares(miss, start, bounds=(_SILENT_DB - 20, 20.0))
    level_db = tuple(round(float(level), 1) for level in solution.x)
    lowest = max(-float(np.percentile(part.change, _LOST_PERCENT)) for part in recorded)
    mean = float(f"{lowest:.3g}")
    return Spectral(mean=mean, level_db=level_db, waves=waves, tile_mm=tile_mm, seed=seed)


def _standing_out(energies: Energies) -> tuple[Wave, ...]:
    """Periods and amplitudes of single waves that have more energy than the band around them."""
    half = energies.low_per_mm  # half the width of a Hann window's main lobe
    edge, spacing = sqrt(_RATIO), half / 4
    ends = np.arange(max(_NODES_PER_MM[0], half) * edge, energies.high_per_mm / edge, spacing)
    middle = ends[ends < _NODES_PER_MM[-1]]
    inside = energies.between(middle - half, middle + half)
    around = energies.between(middle / edge, middle * edge)
    # At low wavenumbers the lobe is as wide as the band, and no single wave can be seen.
    can_stand = (inside > 0.5 * around) & (middle * (edge - 1 / edge) > 4 * half)
    stands = np.where(can_stand, inside, 0.0)
    waves: list[Wave] = []
    while len(waves) < _MOST_WAVES and stands.size and stands.max() > 0:
        best = int(stands.argmax())
        near = np.abs(middle - middle[best]) <= half
        weight = energies.between(middle[near] - spacing / 2, middle[near] + spacing / 2)
        centre = float(np.average(middle[near], weights=weight))
        # Subtract the energy of the band's other waves within the lobe.
        width = 2 * half / (centre * (edge - 1 / edge) - 2 * half)
        alone = float(inside[best]) - width * float(around[best] - inside[best])
        waves.append((float(f"{1 / centre:.4g}"), float(f"{sqrt(2 * alone):.3g}")))
        stands[np.abs(middle - middle[best]) <= 2 * half] = 0.0
    return tuple(waves)


Spectrum = Callable[[Array], Array]
"""Power density against wavenumber [1/mm], 0 or more, on any scale."""

_MOST_PIXELS = 4096**2


def power_law(exponent: float, shortest_mm: float, longest_mm: float) -> Spectrum:
    """Spectrum ``k^-exponent`` between two wavelengths, and 0 elsewhere.

    An exponent of 0 is white; 2 (1 + H) is that of a self-affine surface of Hurst exponent H in two
    dimensions, 1 + 2 H in one.

    Parameters
    ----------
    exponent : float
        How fast the power falls with the wavenumber.
    shortest_mm, longest_mm : float
        The two wavelengths [mm].

    Raises
    ------
    InputError
        If the wavelengths are not above 0 and increasing.

    Examples
    --------
    >>> density = power_law(2.0, shortest_mm=0.5, longest_mm=10.0)
    >>> density(np.array([1.0, 2.0, 4.0])).tolist()  # 4 per mm is shorter than 0.5 mm
    [1.0, 0.25, 0.0]
    """
    number("exponent", exponent)
    if not positive("shortest_mm", shortest_mm) < positive("longest_mm", longest_mm):
        raise InputError(
            f"power_law: expected 0 < shortest_mm < longest_mm, got {shortest_mm:g}, {longest_mm:g}"
        )

    def density(k: Array) -> Array:
        inside = (k >= 1 / longest_mm) & (k <= 1 / shortest_mm)
        return np.where(inside, np.where(inside, k, 1.0) ** -exponent, 0.0)

    return density


class Noise(FrictionField, Material):
    """Gaussian noise on a tile that repeats without a seam.

    Its spectrum is a power law, see `power_law`, or a function. Its tails are not cut off: 5 % of
    all places are more than two deviations from the mean. The renderer treats those outside the
    reachable range.

    Parameters
    ----------
    spectrum : callable, optional
        Power density against wavenumber [1/mm] in place of the power law; no document holds it. The
        wavenumber is the radial one of the plane, or with ``grain="ribbed"`` that along the
        direction.
    mean, deviation : float
        Mean of the friction, and how far it strays from it.
    target : {"share", "mu", "contrast"}
        Quantity of these: shares of the reach of the screen, friction coefficients, or relative
        changes of friction.
    seed : int
        Same seed, same noise.
    tile_mm : float
        Side of the tile.
    pixels : int
        Pixels along it, a power of two.
    grain : {"isotropic", "ribbed"}
        Noise over the plane, or along one direction.
    orientation_deg : float
        Direction of the ribbed grain: 0 to the right, 90 down.
    exponent : float
        The power falls with the wavenumber to this power: 0 is white.
    shortest_mm, longest_mm : float
        Sizes of the smallest and of the largest unevenness: there is power between them.

    Raises
    ------
    InputError
        If a value is outside its range, or the spectrum has nothing between the tile and two
        pixels.

    Examples
    --------
    >>> rough = Noise(mean=0.5, deviation=0.1, seed=1)
    >>> rough.replace(seed=2) == rough
    False
    """

    kind: Literal["noise"] = "noise"
    spectrum: SkipJsonSchema[Spectrum | None] = None
    mean: float = 0.5
    deviation: PositiveFloat = 0.2
    target: Literal["share", "mu", "contrast"] = "share"
    seed: Annotated[int, Field(ge=0)] = 0
    tile_mm: PositiveFloat = 64.0
    pixels: Annotated[int, Field(ge=4, le=_MOST_PIXELS)] = 1024
    grain: Literal["isotropic", "ribbed"] = "isotropic"
    orientation_deg: float = 0.0
    exponent: float = 2.0
    shortest_mm: PositiveFloat = 0.5
    longest_mm: PositiveFloat = 10.0

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        rows = self._rows
        if self.pixels & (self.pixels - 1) or rows * self.pixels > _MOST_PIXELS:
            raise ValueError(
                f"expected pixels that are a power of two, and at most {_MOST_PIXELS} in all, got "
                f"{rows} x {self.pixels}"
            )
        self._density(1)
        return self

    @field_serializer("spectrum")
    def _written(self, spectrum: Spectrum | None) -> None:
        if spectrum is not None:
            raise ValueError(
                "noise: a spectrum that is a function cannot be written; give exponent, "
                "shortest_mm and longest_mm"
            )

    @property
    def evaluator(self) -> Self:
        """Itself, with its tile computed."""
        _ = self.pyramid
        return self

    @property
    def _rows(self) -> int:
        return self.pixels if self.grain == "isotropic" else 1

    @cached_property
    def pyramid(self) -> Pyramid:
        """Its tile."""
        if self.spectrum is not None:
            return self._made()
        return shared(self.model_dump(exclude={"orientation_deg", "target"}), self._made)

    def _made(self) -> Pyramid:
        beyond_y: Beyond = "repeat" if self.grain == "isotropic" else "hold"
        check_room(8 * pyramid_numbers(self._rows, self.pixels, "repeat", beyond_y))
        tile = self.mean + self.deviation * self._tile(self._rows)
        return Pyramid(tile, self.tile_mm / self.pixels, self.mean, "repeat", beyond_y)

    def _density(self, rows: int) -> Array:
        """Density of the spectrum on a tile's wavenumbers, shape (rows, pixels / 2 + 1)."""
        pixel = self.tile_mm / self.pixels
        across = np.fft.rfftfreq(self.pixels, pixel)
        k = np.hypot(np.fft.fftfreq(rows, pixel)[:, None], across)
        spectrum = self.spectrum or power_law(self.exponent, self.shortest_mm, self.longest_mm)
        density = np.broadcast_to(np.asarray(spectrum(k), dtype=np.float64), k.shape).copy()
        density[0, 0] = 0.0  # the field `mean` sets the mean
        if not (np.isfinite(density).all() and (density >= 0).all() and density.any()):
            raise InputError(
                "spectrum: expected finite densities of 0 or more, and some above 0 for waves from "
                f"{2 * pixel:g} to {self.tile_mm:g} mm"
            )
        return density

    def _tile(self, rows: int) -> Array:
        """Noise of mean 0 and deviation 1, shape (rows, pixels)."""
        density = self._density(rows)
        white = np.random.default_rng(self.seed).standard_normal((rows, self.pixels))
        noise = np.fft.irfft2(np.fft.rfft2(white) * np.sqrt(density), s=white.shape)
        return np.asarray(noise / noise.std())

    @property
    def outside(self) -> float:
        """The mean."""
        return self.mean

    def _sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        x_mm, y_mm = turned(x_mm, y_mm, self.orientation_deg)
        return self.pyramid.sample(x_mm, y_mm, footprint_mm)
