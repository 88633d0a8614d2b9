"""Measurements of a finger in files: height maps, line scans, spectra, dielectric tables."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from haptix.base.errors import FileFormatError, HaptixError, InputError, from_extra
from haptix.base.files import LARGEST_TABLE_BYTES, read_bytes, reading
from haptix.base.units import factor_to
from haptix.model.contact.roughness import Convention, RoughnessSpectrum
from haptix.model.contact.topography import MeasuredSurface

_TEXTS = (".csv", ".tsv", ".txt", ".dat")
_UNIT = re.compile(r"^(.*?)(?:[\s_]*[\[(]([^\])]*)[\])]|\s*[/,]\s*([^\s/,]+)|_([A-Za-z]+))?$")
_OWN = ("m", "/m", "m4", "m3", "Hz", "F", "Ohm", "S", "S/m", "Ohm m", "deg")
_WIDEST = 7  # columns of a table; one of more is a map
_VOID = -9999.0  # a missing point of a map, as in ESRI's grids


@dataclass(frozen=True)
class MeasuredTable:
    """Numbers of a text file: names and units as its header has them, or "" without one."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: npt.NDArray[np.float64]
    """Shape (rows, columns)."""

    @classmethod
    def read(cls, path: Path) -> MeasuredTable:
        """Read a table whose rows end in numbers, after any lines of other text.

        Cells are separated by tabs, semicolons, commas or spaces; the decimal sign is a point, or a
        comma where commas separate nothing. The last lines before the numbers name the columns and
        their units: ``q (1/m)``, ``z [um]``, ``f_Hz``, or a line of units of their own.

        Raises
        ------
        FileFormatError
            If there are no such rows, or they are of different lengths.
        """
        raw = read_bytes(path, LARGEST_TABLE_BYTES)
        try:
            text = raw.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = raw.decode("latin-1")
        return cls.of(text, str(path))

    @classmethod
    def of(cls, text: str, place: str) -> MeasuredTable:
        """Read the text of a file; `place` names it in errors."""
        lines = [line.strip(" \r\n") for line in text.splitlines()]
        first = next((n for n, line in enumerate(lines) if _is_numbers(line)), None)
        if first is None:
            raise FileFormatError(f"{place}: expected rows of numbers, got none")
        width, values = len(_split(lines[first])), []
        for number, line in enumerate(lines[first:], start=first + 1):
            if not line or line.startswith("#"):
                continue
            if not _is_numbers(line) or len(_split(line)) != width:
                raise FileFormatError(
                    f"{place}, line {number}: expected {width} numbers as in line {first + 1}, "
                    f"got {line!r:.80}"
                )
            values.append([_number(cell) for cell in _split(line)])
        above = [_split(line.lstrip("#% ")) for line in lines[:first]]
        head = [[cell.strip(' "') for cell in cells] for cells in above if len(cells) == width]
        below: list[str] = []
        if len(head) > 1 and any(_is_unit(cell.strip("[]()")) for cell in head[-1]):
            below = [cell.strip("[]()") for cell in head.pop()]
        named = [_UNIT.match(cell) for cell in (head[-1] if head else [""] * width)]
        names = [match[1].strip() if match else "" for match in named]
        units = [next((g for g in m.groups()[1:] if g), "") if m else "" for m in named]
        return cls(tuple(names), tuple(below or units), np.array(values))

    def column(self, index: int, own: str, unit: str = "") -> npt.NDArray[np.float64]:
        """Return a column in its own unit, such as "m"; `unit` counts where the file has none.

        Raises
        ------
        InputError
            If its unit is not known, or of something else.
        """
        stated = self.units[index] or unit
        factor = factor_to(stated, own)
        if factor is None:
            name = self.names[index] or f"column {index + 1}"
            raise InputError(
                f"{name}: expected a unit such as {own}, got {stated or 'none'}; name it in the "
                "header, as in z (um), or pass --unit"
            )
        return self.values[:, index] * factor


def _is_unit(text: str) -> bool:
    return any(factor_to(text, own) for own in _OWN)


def _split(line: str) -> list[str]:
    mark = next((mark for mark in "\t;," if mark in line), "")
    if not mark:
        return re.findall(r"[^\s(\[]+(?:\s*[(\[][^\])]*[\])])?", line)
    return next(csv.reader([line], delimiter=mark, skipinitialspace=True))


def _number(cell: str) -> float:
    text = cell.strip().strip('"')
    if not text or text.lower() in ("nan", "bad", "---", "***"):
        return float("nan")
    return float(text.replace(",", "."))


def _is_numbers(line: str) -> bool:
    try:
        return not all(np.isnan([_number(cell) for cell in _split(line)])) if line else False
    except ValueError:
        return False


def read_surface(
    path: Path | MeasuredTable,
    unit: str = "",
    pixel_m: float | None = None,
    is_periodic: bool | None = None,
) -> MeasuredSurface:
    """Read a height map or a line scan: numpy, text with units, or what SurfaceTopography reads.

    Parameters
    ----------
    path : Path or MeasuredTable
        ``.npy``: heights. Text, or the columns of one: rows of heights, or position and height.
    unit : str
        Unit of lengths where the file has none, such as "um".
    pixel_m : float, optional
        Distance between pixels [m] where the file has none.
    is_periodic : bool, optional
        Whether the map goes on at its borders as it began, where the file does not state it.

    Raises
    ------
    InputError, FileFormatError
        If it is no such file, or states no unit or pixels.
    """
    if isinstance(path, MeasuredTable):
        return _of_columns(path, "text", unit, pixel_m, is_periodic)
    if path.suffix == ".npy":
        in_metres = _metres(unit, path)
        with reading(path, "heights as numpy.save writes them"):
            heights = _without_voids(np.load(path, allow_pickle=False)) * in_metres
        return MeasuredSurface.of(heights, pixel_m, is_periodic)
    table, wrong = None, None
    if path.suffix.lower() in _TEXTS:
        try:
            table = MeasuredTable.read(path)
        except FileFormatError as error:
            wrong = error
        if table is not None and (unit or any(table.units)):
            return _of_columns(table, path, unit, pixel_m, is_periodic)
    try:  # exports of many instruments are text, too
        return _of_instrument(path, unit, is_periodic)
    except HaptixError:
        if table is not None:
            return _of_columns(table, path, unit, pixel_m, is_periodic)
        if wrong is not None and path.suffix.lower() == ".csv":
            raise wrong from None
        raise


def _of_instrument(path: Path, unit: str, is_periodic: bool | None) -> MeasuredSurface:
    """Read a file by SurfaceTopography."""
    with from_extra("topography"):
        import SurfaceTopography
    try:
        topography = SurfaceTopography.read_topography(str(path))
    except Exception as error:  # each of its readers has errors of its own
        why = str(error).strip().partition("\n")[0]
        raise FileFormatError(
            f"{path}: expected a height map that SurfaceTopography reads, got: {why or error!r}"
        ) from None
    if topography.unit is None and unit:
        heights = topography.heights() * _metres(unit, path)
        pixels = [float(side) * _metres(unit, path) for side in topography.pixel_size]
        return MeasuredSurface.of(heights, pixels, is_periodic)
    return MeasuredSurface.of(topography, None, is_periodic)


def _of_columns(
    table: MeasuredTable,
    path: Path | str,
    unit: str,
    pixel_m: float | None,
    is_periodic: bool | None,
) -> MeasuredSurface:
    if table.values.shape[1] > _WIDEST:
        heights = _without_voids(table.values) * _metres(unit, path)
        return MeasuredSurface.of(heights, pixel_m, is_periodic)
    if table.values.shape[1] == 1:
        return MeasuredSurface.of(table.column(0, "m", unit), pixel_m, is_periodic)
    if table.values.shape[1] > 2:
        raise InputError(
            f"{path}: expected two columns, position and height, or a map of more than {_WIDEST} "
            f"columns, got {table.values.shape[1]}"
        )
    if factor_to(table.units[0], "/m") is not None:
        raise InputError(
            f"{path}: this is a spectrum; name its convention: C of Persson, or C_iso or C_1D of "
            "Jacobs et al. (2017), as SurfaceTopography writes them (--convention)"
        )
    first, second = table.column(0, "m", unit), table.column(1, "m", unit)
    if _rises_or_falls(second) and not _rises_or_falls(first):  # z before x
        first, second = second, first
    return MeasuredSurface.of_line(first, second)


def _without_voids(heights: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return a map in its own unit, with NaN where a number stands for a missing point."""
    return np.where(heights == _VOID, np.nan, heights)


def _rises_or_falls(values: npt.NDArray[np.float64]) -> bool:
    """Whether values can be the places of a scan, each beyond the one before."""
    steps = np.diff(values)
    return bool((steps > 0).all() or (steps < 0).all())


def _metres(unit: str, path: Path | str) -> float:
    factor = factor_to(unit, "m")
    if factor is None:
        raise InputError(
            f"{path}: it does not state the unit of its heights; pass --unit, such as um"
        )
    return factor


def read_spectrum(
    path: Path | MeasuredTable, convention: Convention, unit: str = ""
) -> RoughnessSpectrum:
    """Read a spectrum of two columns, wavenumber and density, in a named convention.

    Parameters
    ----------
    path : Path or MeasuredTable
        Text, or the columns of one; its header names the units, such as ``q (1/um), C (um^4)``.
    convention : {"C", "C_iso", "C_1D"}
        As for `RoughnessSpectrum.from_table`.
    unit : str
        Unit of length where the file has none.

    Raises
    ------
    InputError, FileFormatError
        If it is no such table.
    """
    table = path if isinstance(path, MeasuredTable) else MeasuredTable.read(path)
    if table.values.shape[1] < 2:
        place = "text" if table is path else path
        raise InputError(f"{place}: expected two columns, wavenumber and density, got one")
    power = 3 if convention == "C_1D" else 4
    q = table.column(0, "/m", unit and f"/{unit}")
    density = table.column(1, f"m{power}", unit and f"{unit}{power}")
    there = np.isfinite(q) & np.isfinite(density) & (density > 0) & (q > 0)
    return RoughnessSpectrum.from_table(q[there], density[there], convention)
