"""The engine in C as the source of a driver's queue, for a thread without the interpreter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from firmware_io.own_thread import CompiledSource
from haptix.base.errors import InputError
from haptix.base.native import ffi, library
from haptix.play.render.master import PlayingEffect
from haptix.play.render.program import Compiled, Maps

_WHY = {
    -1: "it is no program of a touch",
    -2: "it is of another version",
    -3: "it is damaged",
    -4: "it has a number that cannot be",
    -5: "it needs too much memory",
}
_FUNCTIONS = ("window", "settle", "played", "report", "is_live")


class _Engine:
    """The engine of a program, and its memory.

    Parameters
    ----------
    compiled : Compiled
    before : _Engine, optional
        Whose maps the program takes over.
    """

    def __init__(self, compiled: Compiled, before: _Engine | None = None) -> None:
        program, of = compiled.program, ffi.NULL if before is None else before.at
        size = library.hx_engine_size_after(program, len(program), of)
        if size < 0:
            raise InputError(f"program: expected one that the engine takes, but {_WHY[size]}")
        self._memory = ffi.new("double[]", size // 8 + 1)
        self.at: Any = library.hx_engine_open_after(program, self._memory, of)
        for number, glide in enumerate(compiled.glides):
            library.hx_engine_glide(self.at, number, ffi.new("hx_glide *", glide))
        self.maps = compiled.maps
        """Materials with maps, and their numbers."""
        known: dict[int, Any] = {} if before is None else before._owners
        # Of each map, in whose memory it lies.
        self._owners: dict[int, Any] = {
            id(felt): known.get(id(felt), self._memory) for felt, _ in self.maps
        }


class EngineCounts(NamedTuple):
    """What an engine has rendered, again or not."""

    samples: int
    statuses: npt.NDArray[np.int64]
    """Samples of all fingers by the number of their `haptix.model.Status`."""
    most_v: float
    """Largest amplitude [V]."""


class EngineSource:
    """Plays a program of a touch; see `haptix.play.compile_touch`.

    Parameters
    ----------
    compiled : Compiled
        The program, and how its regions glide.
    reaction_s : float
        Time from a report to the first sample that can know of it.
    compile_effect : callable
        Returns the program of an effect.

    Raises
    ------
    InputError
        If the engine refuses the program.
    """

    def __init__(
        self,
        compiled: Compiled,
        reaction_s: float,
        compile_effect: Callable[[PlayingEffect], Compiled],
    ) -> None:
        self._compile_effect = compile_effect
        self._engines = [_Engine(compiled)]
        # Of each mix that may still be read, the engines and the records of its effects.
        self._mixes: list[tuple[dict[PlayingEffect, _Engine], Any]] = [({}, None)]
        self._own = ffi.new("double[]", library.hx_live_bytes() // 8 + 1)
        self.at = ffi.cast("hx_live *", self._own)
        """Address of its state."""
        library.hx_live_init(self.at, self._engines[0].at, reaction_s)

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

    def adopt(
        self, compiled: Compiled, mix: tuple[float, ...], effects: Sequence[PlayingEffect] = ()
    ) -> None:
        """Play another program from the next window on, with a mix; the fingers stay.

        Raises
        ------
        InputError
            If the engine refuses a program, or an effect cannot be compiled.
        """
        engine, numbers = _Engine(compiled, self._engines[-1]), self._mix(mix, effects)
        library.hx_live_adopt(self.at, engine.at, numbers)
        kept = [other for other in self._engines if library.hx_live_needs(self.at, other.at)]
        self._engines = [*kept, engine]

    @property
    def maps(self) -> Maps:
        """Materials with maps of the last program, and their numbers; see `compile_core`."""
        return self._engines[-1].maps

    def mix(self, numbers: tuple[float, ...], effects: Sequence[PlayingEffect] = ()) -> None:
        """Take the intensity and the clock of the scene, and effects.

        Parameters
        ----------
        numbers : tuple of float
            See `Master.compiled`.
        effects : sequence of PlayingEffect

        Raises
        ------
        InputError
            If an effect cannot be compiled, or the engine refuses its program.
        """
        library.hx_live_mix(self.at, self._mix(numbers, effects))

    def _mix(self, numbers: tuple[float, ...], effects: Sequence[PlayingEffect]) -> Any:
        """Return an ``hx_mix``; keep what the engine may still read of it."""
        known, _ = self._mixes[-1]
        engines = {
            effect: known.get(effect) or _Engine(self._compile_effect(effect)) for effect in effects
        }
        records = ffi.new("hx_effect[]", [
            (
                engine.at, effect.start_s, effect.end_s, *effect.fades_s,
                ffi.from_buffer("uint8_t[]", effect.felt), len(effect.felt),
            )
            for effect, engine in engines.items()
        ])  # fmt: skip
        if library.hx_live_has_taken(self.at):
            self._mixes = self._mixes[-1:]
        self._mixes.append((engines, records))
        return ffi.new("hx_mix *", (*numbers, records, len(records)))

    @property
    def counts(self) -> EngineCounts:
        """What it has rendered."""
        counts = ffi.new("hx_live_counts *")
        library.hx_live_count(self.at, counts)
        return EngineCounts(counts.samples, np.array([*counts.status]), counts.most_v)
