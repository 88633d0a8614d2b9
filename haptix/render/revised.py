"""Real time with revisions: renders any window of the stream, as often as it is asked for."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack

import numpy as np

from firmware_io import Device, RevisedPlayback, RevisedStats
from firmware_io.revisable import Revisable
from haptix.checks import Array
from haptix.render.core import RenderCore, RenderedBlock
from haptix.render.played import PlayedRecord
from haptix.render.producer import ready_interpreter
from haptix.render.revised_fingers import RevisedFingers


class RevisedSource:
    """Renders windows from what is queued before them; see `firmware_io.reviser.Source`.

    Parameters
    ----------
    core : RenderCore
        Renders.
    fingers : RevisedFingers
        Where they are.
    scene_s : callable
        Time of the scene at a time of samples: less the pauses.
    count : callable
        Takes each block, the time that it took, and when its first sample is played.
    record : callable
        Returns the record of what is played, where one is kept.
    appended : callable
        Called with the index of the first of samples that are new to the driver, before they are
        sent, on the thread that owns the device.
    """

    def __init__(
        self,
        core: RenderCore,
        fingers: RevisedFingers,
        scene_s: Callable[[float], float],
        count: Callable[[RenderedBlock, float, float], None],
        record: Callable[[], PlayedRecord | None] = lambda: None,
        appended: Callable[[int], None] = lambda first: None,
    ) -> None:
        self._core = core
        self._fingers = fingers
        self._scene_s = scene_s
        self._count = count
        self._record = record
        self._appended = appended
        self._amplitudes = Revisable()  # of what is queued, where each step begins
        self._amplitudes.append(np.zeros(1))

    @property
    def grid(self) -> int:
        """Samples in a step."""
        return self._core.step

    @property
    def is_live(self) -> bool:
        """Whether a finger is on the screen, or still fades out."""
        return self._fingers.is_live

    def window(self, first: int, count: int, at_s: float, is_revision: bool) -> Array:
        """Render samples from index `first` on, of which the first is played at `at_s`."""
        began = time.perf_counter()
        core, amplitudes = self._core, self._amplitudes
        step, points = first // core.step, count // core.step
        queued = None
        if is_revision:
            self._fingers.update(at_s)
            start = step + 1 - amplitudes.first
            queued = amplitudes.values[start : start + points]
        since_s = self._scene_s(first / core.sample_rate_hz)
        fingers = self._fingers.motion(at_s, core.step_s, points, since_s, core.drives_at_rest)
        block = core.block(fingers, first, amplitudes[step], queued)
        if is_revision:
            amplitudes.replace(step + 1, block.amplitude_v)
        else:
            amplitudes.append(block.amplitude_v)
            self._appended(first)
        if (record := self._record()) is not None:
            record.add(block, fingers, at_s, is_revision)
        self._count(block, time.perf_counter() - began, at_s)
        return block.drive_v

    def settle(self, obeyed: int, undone: bool) -> None:
        """Take the oldest revisions as played; with `undone`, all others never were."""
        self._amplitudes.accept(obeyed)
        if undone:
            self._amplitudes.undo()
        if (record := self._record()) is not None:
            record.settle(obeyed, undone)

    def played(self, index: int) -> None:
        """Forget what lies before an index."""
        self._amplitudes.drop_before(index // self._core.step)


class RevisedProducer:
    """Thread that renders what is played, a horizon ahead, and again on each touch.

    Parameters
    ----------
    device : Device
        A `RevisedPlayback` owns it and plays on it meanwhile.
    source : RevisedSource
        What is played.
    reaction_s, horizon_s : float
        See `firmware_io.RevisedPlayback`.
    """

    def __init__(
        self,
        device: Device,
        source: RevisedSource,
        reaction_s: float,
        horizon_s: float,
    ) -> None:
        self._playback = RevisedPlayback(device, source, reaction_s, horizon_s)

    @property
    def stats(self) -> RevisedStats:
        """Counts of the playback."""
        return self._playback.stats

    def reactions_s(self, most: int) -> list[float]:
        """Return the reactions to the last touches."""
        return self._playback.reactions_s(most)

    @property
    def shortages(self) -> tuple[int, int]:
        """Underruns, and 0: there are no blocks that come late."""
        return self._playback.underruns, 0

    def start(self) -> None:
        """Arm the device and start the thread."""
        # The collection comes first: it takes long, and an armed driver does not wait.
        with ExitStack() as stack:
            stack.enter_context(ready_interpreter())
            self._playback.start()
            self._interpreter = stack.pop_all()

    def touch(self, touched_s: float) -> None:
        """Render again what is played next."""
        # Once its end was told, touches are taken and lead nowhere.
        if self._playback.is_running:
            self._playback.touch(touched_s)

    def raise_once(self) -> None:
        """Raise the error that ended the thread, once."""
        self._playback.raise_once()

    def stop(self, error: BaseException | None) -> None:
        """End at 0 V; raise the error that ended the thread, unless another one is being raised."""
        self._interpreter.close()
        try:
            self._playback.stop(drain=error is None)
        except BaseException as failure:
            if error is None:
                raise
            if failure is not error:
                error.add_note(f"Stopping the playback failed as well: {failure}")
