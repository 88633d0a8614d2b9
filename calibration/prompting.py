"""Prompts and live numbers on the terminal while a person makes strokes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from calibration.measuring import Watcher
from calibration.protocol import Stroke
from calibration.recording_checks import Finding
from calibration.sources import Live


@contextmanager
def terminal_watcher(strokes: int, ask: bool) -> Iterator[Watcher]:
    """Show a progress bar with force and speed; with `ask`, wait for Enter before each stroke."""
    console = Console(stderr=True)
    bars = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        console=console,
        disable=not console.is_terminal,
    )
    task = bars.add_task("calibrate", total=strokes)

    def prompt(stroke: Stroke, tries: int) -> None:
        if ask:
            bars.stop()
            again = f" (attempt {tries + 1})" if tries else ""
            console.input(f"{stroke.label}{again}: press Enter, wait a moment, then slide ")
            bars.start()

    def live(stroke: Stroke, t_s: float, now: Live) -> None:
        text = (
            f"stroke {stroke.number}: {now.normal_force_n:5.2f} of {stroke.normal_force_n:.2f} N, "
            f"{now.speed_mm_per_s:5.1f} of {stroke.speed_mm_per_s:.0f} mm/s"
        )
        bars.update(task, description=text)

    def done(stroke: Stroke, findings: list[Finding]) -> None:
        for one in findings:
            console.print(f"stroke {stroke.number}: {one}", markup=False, highlight=False)
        if not any(one.is_fatal for one in findings):
            bars.advance(task)

    with bars:
        yield Watcher(prompt, live, done)
