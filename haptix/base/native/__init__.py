"""The inner loops in C: plain functions on arrays, declared in haptix_native.h."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_io.c_library import load

ffi, library = load(
    "haptix-native", *(Path(__file__).parent / f"haptix_{name}.h" for name in ("native", "touch"))
)
NULL = ffi.NULL
_FLOAT64 = np.dtype(np.float64)
DOUBLES = ffi.typeof("double *")
"""For ``ffi.from_buffer(DOUBLES, numbers)``: the address of contiguous numbers in double precision.
It keeps them alive as long as it is kept itself."""
_from_buffer, _empty = ffi.from_buffer, np.empty
_NUMBERS = {"double": _FLOAT64, "int32_t": np.dtype(np.int32)}


def doubles(numbers: npt.NDArray[Any]) -> Any:
    """Return the address of any numbers, or of a copy of the kind that `DOUBLES` expects."""
    if numbers.dtype is _FLOAT64:
        try:
            return _from_buffer(DOUBLES, numbers)
        except ValueError:  # not contiguous
            pass
    return _from_buffer(DOUBLES, np.ascontiguousarray(numbers, dtype=np.float64))


def room(count: int) -> tuple[npt.NDArray[np.float64], Any]:
    """Return space for numbers in double precision, and its address."""
    numbers = _empty(count)
    return numbers, _from_buffer(DOUBLES, numbers)


class Struct:
    """A struct of the library that does not change, with all that it points to.

    Parameters
    ----------
    kind : str
        Its name in the header.
    **fields : number, ndarray, Struct or list of these
        Its fields, by name: arrays for pointers, of the type that they point to.
    """

    def __init__(self, kind: str, **fields: Any) -> None:
        self.fields = fields
        self._made_of = (kind, fields)
        self.at = ffi.new(f"{kind} *")
        """Its address."""
        self._kept: list[Any] = []
        types = dict(ffi.typeof(kind).fields)
        for name, value in fields.items():
            setattr(self.at, name, self._in_c(types[name].type, value))

    def _in_c(self, kind: Any, value: Any) -> Any:
        if isinstance(value, np.ndarray):
            if value.dtype != _NUMBERS[kind.item.cname]:
                raise TypeError(f"expected numbers of {kind.item.cname}, got {value.dtype}")
            value = ffi.from_buffer(kind, value)
        elif isinstance(value, Struct):
            value = value.at[0]
        elif isinstance(value, list):
            value = [entry.at[0] if isinstance(entry, Struct) else entry for entry in value]
            if kind.kind == "pointer":
                value = ffi.new(f"{kind.item.cname}[]", value)
        self._kept.append(value)
        return value

    def __reduce__(self) -> Any:
        return _struct, self._made_of


def _struct(kind: str, fields: dict[str, Any]) -> Struct:
    return Struct(kind, **fields)
