"""Tables on the terminal or as JSON on stdout; progress bars on stderr."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Annotated, Any, Literal, Self

import typer

from haptix.base.errors import HaptixError
from haptix.base.report import record, row, text
from haptix.base.version import foreign_package

_LONGEST_MESSAGE = 10_000
_LIST_LINE = "\n  "
_TELLS_EACH_S = 10.0

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def run(app: Callable[[], object], name: str) -> None:
    """Run a command line; a wrong input is one sentence and exit code 2, never a traceback."""
    try:
        app()
    except HaptixError as error:
        message = str(error)
        if len(message) > _LONGEST_MESSAGE:  # it may quote a file
            message = f"{message[:_LONGEST_MESSAGE]} ..."
        # Names of files may hold line breaks, and characters that move a terminal's cursor. Lines
        # of a list are indented, so that no name begins a line as a message does.
        message = _LIST_LINE.join(
            "".join(char if char.isprintable() else repr(char)[1:-1] for char in line)
            for line in message.split(_LIST_LINE)
        )
        sys.stderr.write(f"{name}: {message}\n")
        sys.exit(getattr(error, "exit_code", 2))
    except ImportError:
        advice = foreign_package("calibration")
        if not advice:
            raise
        sys.stderr.write(f"{name}: {advice}\n")
        sys.exit(2)
    finally:
        sys.stdout.flush()  # a full output raises here, or at Python's own end


def show(title: str, results: Sequence[Any], as_json: bool) -> None:
    """Print results, or mappings with the same keys, as a table or as JSON; lines as they are."""
    if not as_json and results and isinstance(results[0], str):
        sys.stdout.writelines(f"{title}: {line}\n" for line in results)
        return
    if as_json:
        plain = [result if isinstance(result, Mapping) else record(result) for result in results]
        sys.stdout.write(json.dumps(plain, indent=2, allow_nan=False) + "\n")
        return
    rows = [result if isinstance(result, Mapping) else row(result) for result in results]
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table
    from rich.text import Text

    console = Console()
    console.print(Text(title, "table.title"))
    # The box takes a line on each side, and one between two columns.
    columns = (
        [_Column.of(name, [cells[name] for cells in rows]) for name in rows[0]] if rows else []
    )
    widths = _widths(columns, console.width - len(columns) - 1)
    table = Table(box=SIMPLE, padding=0)
    for column, width in zip(columns, widths, strict=True):
        justify: Literal["left", "right"] = "right" if column.is_number else "left"
        table.add_column(escape(column.heading), justify=justify, overflow="fold", width=width)
    for cells in rows:
        table.add_row(*(escape(text(value)) for value in cells.values()))
    # A terminal folds long lines; cutting them off would lose values.
    console.width = max(console.width, sum(widths) + len(columns) + 1)
    console.print(table)


@dataclass(frozen=True)
class _Column:
    """Widths that a column may have."""

    heading: str
    is_number: bool
    least: int
    """Smallest width: numbers are never broken; headings may be, at underscores first."""
    with_words: int
    """Width at which no word of the heading is broken."""
    whole: int

    @classmethod
    def of(cls, name: str, values: Sequence[Any]) -> _Column:
        is_number = isinstance(values[0], int | float) and not isinstance(values[0], bool)
        heading = name.replace("_", " ")
        widest = max(len(text(value)) for value in values)
        least = widest if is_number else min(widest, 8)
        words = max(least, *map(len, heading.split(" ")))
        return cls(heading, is_number, least, words, max(widest, len(heading)))


def _widths(columns: Sequence[_Column], available: int) -> list[int]:
    """Return widths within `available`: the smallest, then with whole words, then with all text."""
    widths = [column.least for column in columns]
    for wanted in ([column.with_words for column in columns], [column.whole for column in columns]):
        while sum(widths) < available:
            short = [at for at, width in enumerate(widths) if width < wanted[at]]
            if not short:
                break
            widths[min(short, key=lambda at: widths[at])] += 1  # widen the narrowest
    return widths


def placeholder_note(
    placeholders: Sequence[str], spread_jnd: Mapping[str, float] | None = None
) -> str:
    """Return the part of a title about inputs that were not measured.

    `spread_jnd` is the difference that other plausible values make.
    """
    if not placeholders:
        return ""
    note = f", with placeholders for {' and '.join(placeholders)}"
    parts = [f"{name} {jnd:.2g} JND" for name, jnd in (spread_jnd or {}).items()]
    return f"{note} (others in their place: {', '.join(parts)})" if parts else note


def accuracy_note(accuracy: Mapping[str, Any] | None) -> str:
    """Return the words for a title of an `Accuracy.record`, where there is one."""
    return "" if accuracy is None else f"; {accuracy['says']}"


def warning_note(warnings: Sequence[str]) -> str:
    """Return the part of a title about results beyond the validated range, or past a limit."""
    return f"; beyond the validated range: {'; '.join(warnings)}" if warnings else ""


class ProgressBar:
    """A bar for each stage once it starts, on the standard error where that is a terminal."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TimeRemainingColumn(),
            TimeElapsedColumn(),
        )
        console = Console(stderr=True)
        self._bars = Progress(*columns, console=console, disable=not console.is_terminal)
        self._tasks: dict[str, Any] = {}
        self._told_s = self._began_s = monotonic()

    def __call__(self, stage: str, share: float) -> None:
        """Show which share of a stage is done; without a terminal, in a line now and then."""
        if self._bars.disable:
            if stage not in self._tasks:
                self._tasks[stage] = self._began_s = monotonic()
            now_s = monotonic()
            if now_s - self._told_s > _TELLS_EACH_S:
                self._told_s = now_s
                left_s = (now_s - self._began_s) * (1 - share) / share if share else None
                left = f", {left_s:.0f} s left" if left_s is not None else ""
                sys.stderr.write(f"haptix: {stage}: {share:.0%}{left}\n")
            return
        self._bars.start()
        if stage not in self._tasks:
            for earlier in self._tasks.values():
                self._bars.update(earlier, completed=1.0)
            self._tasks[stage] = self._bars.add_task(stage, total=1.0)
        self._bars.update(self._tasks[stage], completed=share)

    def note(self, line: str) -> None:
        """Show a line beside the bar of the present stage."""
        for stage in [] if self._bars.disable else [*self._tasks][-1:]:
            self._bars.update(self._tasks[stage], description=f"{stage}: {line}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.pause()

    def pause(self) -> None:
        """Leave the terminal to a person; the next call shows the bars again."""
        self._bars.stop()
