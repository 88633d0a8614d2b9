"""Recorded profiles: friction against position, extruded across."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import ceil
from pathlib import Path
from typing import ClassVar, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import PositiveFloat

from haptix.base.checks import Array, choice, increasing, number, positive, row
from haptix.base.display import Displayed
from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import read_csv
from haptix.base.kinds import AnyAsset
from haptix.feel.materials.field import FrictionField, TargetKind, check_target, turned
from haptix.feel.materials.material import Material
from haptix.feel.materials.patterns import hjif_profile
from haptix.feel.materials.pyramid import Pyramid

_MOST_SAMPLES = 4_000_000


@dataclass(frozen=True)
class RecordedProfile(Displayed, FrictionField):
    """Friction recorded along a line, the same all across it.

    Between the positions the values are linear. At a point they are these lines; with a footprint
    they are read from an even grid, as fine as the closest two positions or of `step_mm`.

    Parameters
    ----------
    position_mm : array_like, shape (samples,)
        Increasing positions along the line.
    value : array_like, shape (samples,)
        Recorded values there.
    target : {"mu", "contrast", "share"}
        Quantity of the values, see `haptix.feel.as_mu`.
    orientation_deg : float
        Direction of the line from the origin: 0 to the right, 90 down.
    beyond : {"outside", "hold"}
        Value beyond the ends: the lowest, or that of the end.
    step_mm : float, optional
        Step of the even grid.

    Raises
    ------
    InputError
        If positions or values are not finite, too few, or not increasing, or the grid would have
        more than 4 million steps.

    Examples
    --------
    >>> from haptix.feel import Motion
    >>> profile = RecordedProfile([0.0, 10.0], [0.2, 0.4])
    >>> round(float(profile.wanted(Motion.of(5.0, 0.0))[0]), 6)
    0.3
    """

    position_mm: npt.ArrayLike
    value: npt.ArrayLike
    target: TargetKind = "mu"
    orientation_deg: float = 0.0
    beyond: Literal["outside", "hold"] = "outside"
    step_mm: float | None = None
    _corners: tuple[Array, Array] = field(init=False, repr=False, compare=False)
    _pyramid: Pyramid = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_target(self.target)
        choice("beyond", self.beyond, ("outside", "hold"))
        number("orientation_deg", self.orientation_deg)
        if self.step_mm is not None:
            positive("step_mm", self.step_mm)
        try:
            position = increasing("position_mm", self.position_mm, 2)
        except InputError as error:
            raise InputError(f"{error}; sort them, or keep one stroke of several") from None
        value = row("value", self.value, 2)
        if len(value) != len(position):
            raise InputError(
                f"value: expected one for each of the {len(position)} positions, got {len(value)}"
            )
        step = float(np.diff(position).min()) if self.step_mm is None else self.step_mm
        length = float(position[-1] - position[0])
        count = ceil(length / step * (1 - 1e-9)) + 1
        if count > _MOST_SAMPLES:
            raise InputError(
                f"step_mm: {length:g} mm in steps of {step:g} mm are {count} samples; expected "
                f"at most {_MOST_SAMPLES}, give a larger step_mm"
            )
        step = length / (count - 1)
        even = np.interp(position[0] + step * np.arange(count), position, value)
        pyramid = Pyramid(even[None, :], step, float(value.min()), self.beyond, "hold")
        object.__setattr__(self, "_corners", (position, value))
        object.__setattr__(self, "_pyramid", pyramid)

    @classmethod
    def from_csv(
        cls,
        path: str | Path,
        normal_force_n: float | None = None,
        orientation_deg: float = 0.0,
        beyond: Literal["outside", "hold"] = "outside",
        step_mm: float | None = None,
    ) -> Self:
        """Read columns ``position_mm`` and ``mu``, or the tangential and the normal force.

        Parameters
        ----------
        path : path
            CSV with a line of names. Without ``mu`` it needs ``tangential_force_n`` and, unless it
            is given here, ``normal_force_n``; other columns are ignored.
        normal_force_n : float, optional
            The normal force, if it was constant and is not a column.
        orientation_deg, beyond, step_mm
            See the class.

        Raises
        ------
        FileFormatError
            If the file cannot be read, a column is missing or a cell is not a number.
        InputError
            If the numbers are not a profile.
        """
        rows = list(read_csv(path, ("position_mm",)))
        names = rows[0].cells if rows else {}
        if not {"mu", "tangential_force_n"} & set(names):
            raise FileFormatError(
                f"{path}: expected columns position_mm and mu, or position_mm and "
                f"tangential_force_n, got {', '.join(names)}"
            )
        table = {
            name: np.array([row.number(name) for row in rows])
            for name in ("position_mm", "mu", "tangential_force_n", "normal_force_n")
            if name in names
        }
        if "mu" in table:
            mu = table["mu"]
        else:
            normal: npt.ArrayLike | None = table.get("normal_force_n", normal_force_n)
            if normal is None:
                raise InputError(
                    f"{path}: expected a column normal_force_n beside tangential_force_n, or the "
                    "one force as normal_force_n="
                )
            force = np.asarray(normal, dtype=np.float64)
            if not (force > 0).all():
                raise InputError(f"{path}: expected normal forces above 0 N")
            mu = table["tangential_force_n"] / force
        return cls(table["position_mm"], mu, "mu", orientation_deg, beyond, step_mm)

    @property
    def outside(self) -> float:
        """The lowest value."""
        return float(self._corners[1].min())

    def _sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        along, across = turned(x_mm, y_mm, self.orientation_deg)
        position, value = self._corners
        if not isinstance(footprint_mm, np.ndarray) and footprint_mm == 0:
            beyond = self.outside if self.beyond == "outside" else None
            return np.interp(along, position, value, beyond, beyond)
        # The pyramid's first value lies half a step from its corner.
        start = float(position[0]) - self._pyramid.pixel_mm / 2
        return self._pyramid.sample(along - np.array(start), across, footprint_mm)


class Recording(Material):
    """Friction recorded along a line, the same across it.

    Parameters
    ----------
    file : str
        CSV with position_mm and mu, or with position_mm and forces; or HJIF of friction.
    normal_force_n : float, optional
        The normal force of the recording, where it is no column.
    orientation_deg : float
        Direction of the line: 0 to the right, 90 down.
    beyond : {"outside", "hold"}
        Friction beyond the ends: the lowest, or that of the end.
    step_mm : float, optional
        Step of the even grid on which it is kept.
    """

    kind: Literal["recording"] = "recording"
    target: ClassVar[TargetKind] = "mu"
    file: AnyAsset
    normal_force_n: PositiveFloat | None = None
    orientation_deg: float = 0.0
    beyond: Literal["outside", "hold"] = "outside"
    step_mm: PositiveFloat | None = None

    @cached_property
    def evaluator(self) -> RecordedProfile:
        """A `RecordedProfile`."""
        options = self.model_dump(exclude={"kind", "file"})

        def read(path: Path) -> RecordedProfile:
            if path.suffix != ".hjif":
                return RecordedProfile.from_csv(path, **options)
            x_mm, mu, _ = hjif_profile(path)
            of_line = {name: options[name] for name in ("orientation_deg", "beyond", "step_mm")}
            return RecordedProfile(x_mm, mu, **of_line)

        return self.file.shared(options, read)
