"""How objects are shown, as one line, as a table in a notebook or in axes; and `==` as a bool."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from haptix.base.errors import from_extra

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

_LONGEST = 60  # characters of a value, if it is no array


class Displayed:
    """Base of what holds arrays: a short `repr`, a table in notebooks, and `==` by value.

    Arrays are shown by their shape and range. Two dataclasses are equal if all arrays and values
    are; NaN equals NaN. Other classes keep their identity.
    """

    __slots__ = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for name in ("__repr__", "__eq__", "__hash__"):  # a dataclass keeps its own
            if name not in cls.__dict__:
                setattr(cls, name, getattr(Displayed, name))

    def _shown(self) -> Mapping[str, Any]:
        """Return the values that are shown, by name."""
        if not is_dataclass(self):
            return {}
        return {field.name: getattr(self, field.name) for field in fields(self) if field.repr}

    def __repr__(self) -> str:
        words = (f"{name}={brief(value)}" for name, value in self._shown().items())
        return f"{type(self).__name__}({', '.join(words)})"

    def _repr_html_(self) -> str:
        return html_table(type(self).__name__, self._shown())

    def __eq__(self, other: object) -> bool:
        if self is other or type(self) is not type(other) or not is_dataclass(self):
            return self is other
        compared = (field.name for field in fields(self) if field.compare)
        return all(_are_same(getattr(self, name), getattr(other, name)) for name in compared)

    def __hash__(self) -> int:
        if not is_dataclass(self):
            return object.__hash__(self)
        values = (getattr(self, field.name) for field in fields(self) if field.compare)
        return hash((type(self), *(tuple(getattr(value, "shape", ())) for value in values)))


class Table(Displayed):
    """Base of classes with a row for each instant: arrays of one length."""

    __slots__ = ()

    def to_pandas(self) -> pandas.DataFrame:
        """Return the arrays as columns of a table (extra ``netcdf``, which brings pandas).

        Examples
        --------
        >>> from haptix import Trajectory
        >>> Trajectory.of([0.0, 1.0], [0.0, 50.0], 20.0, 0.5).to_pandas()["x_mm"].tolist()
        [0.0, 50.0]
        """
        with from_extra("netcdf"):
            import pandas
        arrays = {name: as_numpy(v) for name, v in self._shown().items() if hasattr(v, "shape")}
        return pandas.DataFrame({name: array for name, array in arrays.items() if array.ndim == 1})


def brief(value: Any) -> str:
    """Return one short line for a value: an array's shape and range, a number's six digits.

    Examples
    --------
    >>> brief(np.array([[1.0, 2.0], [3.0, 4.0]]))
    '<2 x 2: 1 to 4>'
    """
    if isinstance(value, str):
        return value if len(value) <= _LONGEST else f"{value[: _LONGEST - 3]}..."
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        array = as_numpy(value)
        if array.size == 1:
            return f"{array.item():.6g}"
        shape = " x ".join(map(str, array.shape))
        if not array.size or array.dtype.kind not in "fiub":
            return f"<{shape} {array.dtype}>"
        finite = array[np.isfinite(array)]
        ends = f"{finite.min():.6g} to {finite.max():.6g}" if finite.size else "nan"
        return f"<{shape}: {ends}>"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Displayed):
        return f"{type(value).__name__}(...)"
    return brief(str(value))


def html_table(title: str, shown: Mapping[str, Any]) -> str:
    """Return names and values as notebooks show them."""
    rows = "".join(
        f"<tr><th>{escape(name)}</th><td>{escape(brief(value))}</td></tr>"
        for name, value in shown.items()
    )
    return f"<table><caption>{escape(title)}</caption>{rows}</table>"


def axes_or_new(ax: Axes | None) -> Axes:
    """Return the axes to draw into, or those of a new figure."""
    if ax is None:
        with from_extra("figures"):
            from matplotlib import pyplot

        _, ax = pyplot.subplots(layout="constrained")
    return ax


def as_numpy(array: Any) -> Any:
    """Return a tensor or array as numpy's."""
    return np.asarray(array.detach().cpu() if hasattr(array, "detach") else array)


def _are_same(this: Any, other: Any) -> bool:
    if this is other:
        return True
    if hasattr(this, "dtype") and hasattr(other, "dtype"):
        left, right = as_numpy(this), as_numpy(other)
        return left.dtype == right.dtype and np.array_equal(
            left, right, equal_nan=left.dtype.kind in "fc"
        )
    if isinstance(this, float) and this != this:
        return isinstance(other, float) and other != other
    if isinstance(this, Mapping) and isinstance(other, Mapping):
        return this.keys() == other.keys() and all(_are_same(this[key], other[key]) for key in this)
    if isinstance(this, list | tuple) and isinstance(other, list | tuple):  # a file has no tuples
        return len(this) == len(other) and all(map(_are_same, this, other))
    return bool(this == other)
