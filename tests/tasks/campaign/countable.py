"""A kind of tasks for tests: cheap, and on demand slow, wrong or deadly."""

import os
import signal
import time
from pathlib import Path

from haptix.base.task import Result, Task
from haptix.tasks.campaign import Campaign, CampaignTask


class Square(Task):
    """The square of a number, which may do harm."""

    number: int
    seconds: float
    file_bytes: int
    deadly: bool = False
    wrong: bool = False
    greedy: bool = False
    held: bool = False
    waits_for: str = ""
    dies_writing: str = ""

    def run(self, context):
        number = self.number
        if self.deadly:
            os.kill(os.getpid(), signal.SIGKILL)
        if self.wrong:
            raise ValueError(f"no square of {number}")
        if self.greedy:
            bytearray(4_000_000_000)
        while self.held and not Path(self.waits_for).exists():
            time.sleep(0.01)
        end = time.monotonic() + self.seconds
        while time.monotonic() < end:
            time.sleep(0.001)
        files: dict[str, object] = {}
        if self.file_bytes:
            data = bytes((number + i) % 251 for i in range(self.file_bytes))
            files["numbers.bin"] = data
            if self.waits_for:
                gate = Path(self.waits_for)
                files = {"numbers.bin": lambda path: write_and_wait(path, data, gate)}
            if marker := self.dies_writing:
                files = {"first.bin": data, "numbers.bin": lambda path: write(path, data, marker)}
        return Result({"number": number, "square": number**2}, files=files, costs={"slept": 1.0})


class Countable(Campaign):
    """Squares of numbers; some of them do harm."""

    numbers: int
    seconds: float = 0.0
    file_bytes: int = 0
    deadly: tuple[int, ...] = ()
    wrong: tuple[int, ...] = ()
    greedy: tuple[int, ...] = ()
    waits_for: str = ""
    """A file whose absence stops a worker in the middle of writing."""
    held: tuple[int, ...] = ()
    """Those that do not end before the file of `waits_for` is there."""
    dies_writing: str = ""
    """A file that is made when a worker dies in the middle of writing, once."""

    def tasks(self):
        for number in range(self.numbers):
            harm = ("deadly", "wrong", "greedy", "held")
            task = Square(
                number=number,
                seconds=self.seconds,
                file_bytes=self.file_bytes,
                waits_for=self.waits_for if not self.held or number in self.held else "",
                dies_writing=self.dies_writing,
                **{name: number in getattr(self, name) for name in harm},
            )
            yield CampaignTask(task, {"label": f"n{number}"})


def write(path, data, marker):
    """Write a file; whoever comes first dies half-way."""
    with path.open("wb") as file:
        file.write(data[: len(data) // 2])
        file.flush()
        if not Path(marker).exists():
            Path(marker).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        file.write(data[len(data) // 2 :])


def write_and_wait(path, data, gate):
    """Write a file in two halves, the second once there is a gate."""
    with path.open("wb") as file:
        file.write(data[: len(data) // 2])
        file.flush()
        while not gate.exists():
            time.sleep(0.01)
        file.write(data[len(data) // 2 :])
