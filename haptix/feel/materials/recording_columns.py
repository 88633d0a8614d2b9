"""Column maps of friction that others have recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import PositiveFloat, model_validator

from haptix.base.checks import Array
from haptix.base.documents import Document, Part
from haptix.base.errors import FileFormatError
from haptix.base.fields import LIFTED_BELOW_N
from haptix.base.tables import read_table, split_unit
from haptix.base.units import factor_to, unit_of

_Signal = Literal[
    "t_s",
    "position_mm",
    "speed_mm_per_s",
    "mu",
    "tangential_force_n",
    "normal_force_n",
    "acceleration_m_per_s2",
]


class RecordedColumn(Part):
    """Where a signal of a recording of friction comes from.

    Parameters
    ----------
    column : str or None
        Heading of its column.
    value : float or None
        A constant instead.
    scale : float, optional
        Factor to the signal's unit, such as 9.80665 for an acceleration in g. Without it, the unit
        that the file states counts, or else the signal's own.
    file : str or None
        Another file, from the folder of the first one; ``{stem}`` is the first one's name.
    time : str
        Times in that file, in seconds or the unit that it states.
    """

    column: str | None = None
    value: float | None = None
    scale: float | None = None
    file: str | None = None
    time: str = "time"

    @model_validator(mode="after")
    def _comes_from_somewhere(self) -> Self:
        if (self.column is None) == (self.value is None):
            raise ValueError("expected one of column and value")
        return self


class RecordingColumns(Document):
    """Column map of a recording of friction by other people: a TOML file.

    For the Cluster Haptic Texture Database, whose folders ``accel``, ``force`` and ``position``
    have a file of the same name for each slide (``material fit force/0_135_40_500_0.csv``)::

        mass_kg = 0.05                                     # of what slides: an assumption
        [columns]
        t_s = { column = "time" }
        normal_force_n = { column = "force" }
        speed_mm_per_s = { value = 40 }
        mu = { value = 0.5 }                               # the mean, which was not recorded
        acceleration_m_per_s2 = { column = "X", scale = 9.80665, file = "../accel/{stem}.csv" }

    Parameters
    ----------
    columns : mapping of str to RecordedColumn
        t_s; position_mm or speed_mm_per_s; mu, or tangential_force_n; normal_force_n; and an
        acceleration along the stroke, whose part above the recording's mean adds
        ``mass_kg a / F_N`` to mu.
    mass_kg : float, optional
        Turns the acceleration into friction.
    """

    columns: dict[_Signal, RecordedColumn]
    mass_kg: PositiveFloat | None = None

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        t_s = self.columns.get("t_s")
        if t_s is None or t_s.column is None or t_s.file is not None:
            raise ValueError("expected t_s = its column in the first file")
        needed = {"mu", "normal_force_n"} - self.columns.keys()
        if "acceleration_m_per_s2" in self.columns and (needed or self.mass_kg is None):
            raise ValueError(
                "an acceleration needs mass_kg, normal_force_n and a mean mu beside it"
            )
        return self

    def read(self, path: str | Path) -> dict[str, Array]:
        """Read the signals at the times of the first file.

        Raises
        ------
        FileFormatError
            If a file cannot be read or a column is missing.
        """
        path = Path(path)
        t_s = self._column(path, "t_s", self.columns["t_s"])
        at: dict[str, Array] = {}
        for name, column in self.columns.items():
            if column.value is not None:
                at[name] = np.full(
                    len(t_s), column.value * (1.0 if column.scale is None else column.scale)
                )
            elif column.file is None:
                at[name] = self._column(path, name, column)
            else:
                other = path.parent / column.file.replace("{stem}", path.stem)
                own_s = self._column(other, "t_s", RecordedColumn(column=column.time))
                at[name] = np.interp(t_s, own_s, self._column(other, name, column))
        if self.mass_kg is not None and "acceleration_m_per_s2" in at:
            shaken = at.pop("acceleration_m_per_s2")
            force = np.maximum(at["normal_force_n"], LIFTED_BELOW_N)
            at["mu"] = at["mu"] + self.mass_kg * (shaken - shaken.mean()) / force
        return at

    def _column(self, path: Path, name: str, column: RecordedColumn) -> Array:
        assert column.column is not None
        table = read_table(path, [column.column])
        heading = table.named(column.column) or ""
        scale, unit = column.scale, split_unit(heading)[1] or table.units.get(heading, "")
        if scale is None:
            scale = factor_to(unit, unit_of(name)) if unit and unit_of(name) else 1.0
        if scale is None:
            raise FileFormatError(
                f"{path}: {name}: expected a column in {unit_of(name)}, got {heading!r:.80} in "
                f"{unit}; state its factor as scale"
            )
        return np.asarray(table.columns[heading] * scale)
