"""A kind of tasks for tests: cheap, and on demand slow, wrong or deadly."""

import os
import signal
import time
from pathlib import Path

from haptix.campaign import Campaign, CampaignTask, Outcome


class Countable(Campaign):
    """Squares of numbers; some of them do harm."""

    shown = ("square",)
    maps = (("number", "square"),)

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
            document: dict[str, object] = {
                "number": number,
                "seconds": self.seconds,
                "file_bytes": self.file_bytes,
            }
            for harm in ("deadly", "wrong", "greedy", "held"):
                if number in getattr(self, harm):
                    document[harm] = True
            if self.waits_for and (not self.held or number in self.held):
                document["waits_for"] = self.waits_for
            if self.dies_writing:
                document["dies_writing"] = self.dies_writing
            yield CampaignTask(self.kind, document, {"label": f"n{number}"})

    @staticmethod
    def run(document):
        number = document["number"]
        if document.get("deadly"):
            os.kill(os.getpid(), signal.SIGKILL)
        if document.get("wrong"):
            raise ValueError(f"no square of {number}")
        if document.get("greedy"):
            bytearray(4_000_000_000)
        while document.get("held") and not Path(document["waits_for"]).exists():
            time.sleep(0.01)
        end = time.monotonic() + document["seconds"]
        while time.monotonic() < end:
            time.sleep(0.001)
        files: dict[str, object] = {}
        if size := document["file_bytes"]:
            data = bytes((number + i) % 251 for i in range(size))
            files["numbers.bin"] = data
            if gate := document.get("waits_for"):
                files = {"numbers.bin": lambda path: write_and_wait(path, data, Path(gate))}
            if marker := document.get("dies_writing"):
                files = {"first.bin": data, "numbers.bin": lambda path: write(path, data, marker)}
        return Outcome({"number": number, "square": number**2}, files, {"slept": 1.0})


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
