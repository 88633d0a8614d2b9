"""The engine in C as the source of a driver's queue, for a thread without the interpreter."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from firmware_io.own_thread import CompiledSource
from haptix.base.errors import InputError
from haptix.base.native import ffi, library

_WHY = {
    -1: "it is no program of a touch",
    -2: "it is of another version",
    -3: "it is damaged",
    -4: "it has a number that cannot be",
    -5: "it needs too much memory",
}
_FUNCTIONS = ("window", "settle", "played", "report", "is_live")
_STATUSES = 16


class EngineSource:
    """Plays a program of a touch; see `haptix.play.compile_touch`.

    Parameters
    ----------
    program : bytes
        The contents of a ``.hxp`` file.
    reaction_s : float
        Time from a report to the first sample that can know of it.

    Raises
    ------
    InputError
        If the engine refuses the program.
    """

    def __init__(self, program: bytes, reaction_s: float) -> None:
        size = library.hx_engine_size(program, len(program))
        if size < 0:
            raise InputError(f"program: expected one that the engine takes, but {_WHY[size]}")
        self._memory = ffi.new("double[]", size // 8 + 1)
        self._engine = library.hx_engine_open(program, len(program), self._memory)
        self._own = ffi.new("double[]", library.hx_live_bytes() // 8 + 1)
        self.at = ffi.cast("hx_live *", self._own)
        """Address of its state."""
        library.hx_live_init(self.at, self._engine, reaction_s)

    def compiled(self, grid: int) -> CompiledSource:
        """Return its addresses.

        Parameters
        ----------
        grid : int
            Samples from one control point to the next.
        """
        functions = (getattr(library, f"hx_live_{name}") for name in _FUNCTIONS)
        addresses = [int(ffi.cast("uintptr_t", function)) for function in functions]
        return CompiledSource(grid, int(ffi.cast("uintptr_t", self.at)), tuple(addresses), self)

    def mix(self, numbers: tuple[float, ...]) -> None:
        """Take the intensity and the clock of the scene; see `Master.compiled`."""
        library.hx_live_mix(self.at, ffi.new("hx_mix *", numbers))

    @property
    def statuses(self) -> npt.NDArray[np.int64]:
        """Samples of all fingers by the number of their `haptix.model.Status`."""
        counts = np.empty(_STATUSES, np.int64)
        library.hx_live_count(self.at, ffi.from_buffer("int64_t[]", counts))
        return counts
