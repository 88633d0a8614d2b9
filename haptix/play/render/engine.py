"""The engine in C as the source of a driver's queue, for a thread without the interpreter."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_io.own_thread import CompiledSource
from haptix.base.errors import InputError
from haptix.base.native import ffi, library
from haptix.play.render.program import Compiled

_WHY = {
    -1: "it is no program of a touch",
    -2: "it is of another version",
    -3: "it is damaged",
    -4: "it has a number that cannot be",
    -5: "it needs too much memory",
}
_FUNCTIONS = ("window", "settle", "played", "report", "is_live")
_STATUSES = 16


def _opened(compiled: Compiled) -> tuple[Any, Any]:
    """Return the engine of a program, and its memory."""
    program = compiled.program
    size = library.hx_engine_size(program, len(program))
    if size < 0:
        raise InputError(f"program: expected one that the engine takes, but {_WHY[size]}")
    memory = ffi.new("double[]", size // 8 + 1)
    engine = library.hx_engine_open(program, len(program), memory)
    for number, glide in enumerate(compiled.glides):
        library.hx_engine_glide(engine, number, ffi.new("hx_glide *", glide))
    return engine, memory


class EngineSource:
    """Plays a program of a touch; see `haptix.play.compile_touch`.

    Parameters
    ----------
    compiled : Compiled
        The program, and how its regions glide.
    reaction_s : float
        Time from a report to the first sample that can know of it.

    Raises
    ------
    InputError
        If the engine refuses the program.
    """

    def __init__(self, compiled: Compiled, reaction_s: float) -> None:
        self._engines = [_opened(compiled)]
        self._own = ffi.new("double[]", library.hx_live_bytes() // 8 + 1)
        self.at = ffi.cast("hx_live *", self._own)
        """Address of its state."""
        library.hx_live_init(self.at, self._engines[0][0], reaction_s)

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

    def adopt(self, compiled: Compiled, mix: tuple[float, ...]) -> None:
        """Play another program from the next window on, with a mix; the fingers stay.

        Raises
        ------
        InputError
            If the engine refuses the program.
        """
        engine = _opened(compiled)
        library.hx_live_adopt(self.at, engine[0], ffi.new("hx_mix *", mix))
        kept = [other for other in self._engines if library.hx_live_needs(self.at, other[0])]
        self._engines = [*kept, engine]

    def mix(self, numbers: tuple[float, ...]) -> None:
        """Take the intensity and the clock of the scene; see `Master.compiled`."""
        library.hx_live_mix(self.at, ffi.new("hx_mix *", numbers))

    @property
    def statuses(self) -> npt.NDArray[np.int64]:
        """Samples of all fingers by the number of their `haptix.model.Status`."""
        counts = np.empty(_STATUSES, np.int64)
        library.hx_live_count(self.at, ffi.from_buffer("int64_t[]", counts))
        return counts
