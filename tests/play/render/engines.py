"""An engine of the library in C, for tests."""

import numpy as np

from haptix.base.native import NULL, doubles, ffi, library


class Refused(Exception):
    """The engine refuses a program; its argument is why."""


class Block:
    """Copies of what an engine has played."""

    def __init__(self, felt):
        size = felt.fingers * felt.points

        def row(pointer, count=size):
            return np.frombuffer(ffi.buffer(pointer, 8 * count), np.float64).copy() if count else []

        names = ("x_mm", "y_mm", "force_n", "wanted_mu", "felt_mu")
        self.x_mm, self.y_mm, self.force_n, self.wanted_mu, self.felt_mu = (
            np.asarray(row(getattr(felt, name))) for name in names
        )
        self.status = np.frombuffer(ffi.buffer(felt.status, size), np.int8).copy()
        self.amplitude_v = row(felt.amplitude_v, felt.points)
        self.drive_v = row(felt.drive_v, felt.points * felt.step)
        self.fingers, self.first_sample = felt.fingers, felt.first_sample


class Engine:
    """Plays a program."""

    def __init__(self, program):
        size = library.hx_engine_size(program, len(program))
        if size < 0:
            raise Refused(size)
        self._memory = ffi.new("double[]", size // 8 + 1)
        self._at = library.hx_engine_open(program, len(program), self._memory)

    def play(self, motion, gain):
        """Play fingers at given places."""
        rows = [
            np.ascontiguousarray(row, np.float64)
            for row in (
                motion.x_mm, motion.y_mm, motion.vx_mm_s, motion.vy_mm_s, motion.normal_force_n,
                gain,
            )
        ]  # fmt: skip
        # Of a motion with times of its own, those of its first point.
        start_s = motion.start_s
        if isinstance(start_s, np.ndarray):
            start_s = float(start_s[0]) - motion.step_s
        on = ffi.new("hx_motion *", (
            motion.fingers, motion.points, *map(doubles, rows[:5]), motion.footprint_mm,
            motion.step_s, start_s, NULL, NULL,
        ))  # fmt: skip
        felt = library.hx_engine_play(self._at, on, doubles(rows[5]))
        return Block(felt)

    def touch(self, touch_id, t_s, x_mm, y_mm, force_n=0.0, is_down=True):
        """Report a finger."""
        return library.hx_engine_touch(self._at, touch_id, t_s, x_mm, y_mm, force_n, is_down)

    def block(self, points):
        """Play the next points."""
        return Block(library.hx_engine_block(self._at, points))
