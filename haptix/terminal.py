"""Tables on the terminal or as JSON on stdout; progress bars on stderr."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Annotated, Any

import typer

from haptix.errors import HaptixError

_LONGEST_MESSAGE = 10_000

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def run(app: Callable[[], object], name: str) -> None:
    """Run a command line; a wrong input is one sentence and exit code 2, never a traceback."""
    try:
        app()
    except HaptixError as error:
        text = str(error)
        if len(text) > _LONGEST_MESSAGE:  # it may quote a file
            text = f"{text[:_LONGEST_MESSAGE]} ..."
        sys.stderr.write(f"{name}: {text}\n")
        sys.exit(2)


def show(title: str, rows: Sequence[Mapping[str, Any]], as_json: bool) -> None:
    """Print rows with the same columns as a table, or as JSON."""
    if as_json:
        sys.stdout.write(json.dumps(rows, indent=2, allow_nan=False) + "\n")
        return
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=SIMPLE, padding=0)
    for name, value in rows[0].items() if rows else ():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        # Headings may break at underscores, numbers not: so tables fit a terminal.
        widest = max(len(_text(row[name])) for row in rows)
        table.add_column(
            name.replace("_", " "),
            justify="right" if number else "left",
            overflow="fold",
            min_width=widest if number else min(widest, 8),
        )
    for row in rows:
        table.add_row(*(escape(_text(value)) for value in row.values()))
    Console().print(table)


def placeholder_note(
    placeholders: Sequence[str], spread_jnd: Mapping[str, float] | None = None
) -> str:
    """Return what a title says about inputs that were not measured.

    `spread_jnd` is the difference that others in their place make.
    """
    if not placeholders:
        return ""
    note = f", with placeholders for {' and '.join(placeholders)}"
    parts = [f"{name} {jnd:.2g} JND" for name, jnd in (spread_jnd or {}).items()]
    return f"{note} (others in their place: {', '.join(parts)})" if parts else note


PULL_PAST_BREAKDOWN = 0.5
"""Share of the attraction beyond what gaps bear from which outputs warn."""


def breakdown_note(share: float) -> str:
    """Return what a title says of a `ContactState.pull_past_breakdown`, the largest of many."""
    if share < PULL_PAST_BREAKDOWN:
        return ""
    return (
        f"; warning: up to {share:.0%} of the attraction comes from gaps whose field is past what "
        "they bear: they spark or leak, and friction is likely to be lower"
    )


def warning_note(warnings: Sequence[str]) -> str:
    """Return what a title says about results below what was validated."""
    return f"; beyond what was validated: {'; '.join(warnings)}" if warnings else ""


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


@contextmanager
def progress_bar(stages: Mapping[str, str]) -> Iterator[Callable[[str, float], None]]:
    """Show a bar for each stage once it starts; yields ``update(stage, share)``."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        tasks: dict[str, Any] = {}

        def update(stage: str, share: float) -> None:
            if stage not in tasks:
                for earlier in tasks.values():
                    progress.update(earlier, completed=1.0)
                tasks[stage] = progress.add_task(stages[stage], total=1.0)
            progress.update(tasks[stage], completed=share)

        yield update
