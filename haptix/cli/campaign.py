"""``haptix campaign``."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import AfterValidator

from haptix.desk import argument, checked, option
from haptix.fields import FileThere, Positive, Text, folder, is_there, one_of
from haptix.terminal import AsJson, show

_SAY_EVERY_S = 10.0


def _folder_or_url(value: str) -> str:
    if "://" not in value:
        folder(Path(value))
    return value


def _executor_named(value: str) -> str:
    if "/" not in value and "." not in value:
        one_of("processes", "dask")(value)
    elif "://" not in value:
        is_there(Path(value))
    return value


def campaign(
    plan: Annotated[Path, argument("Campaign: a TOML file.", FileThere)],
    out: Annotated[
        str | None,
        typer.Option(
            help="Folder, or a URL of fsspec such as s3://bucket/name. [default: the plan's name]",
            callback=checked(Annotated[Text, AfterValidator(_folder_or_url)]),
        ),
    ] = None,
    on: Annotated[
        str,
        typer.Option(
            help="processes: of this machine; dask: a local cluster; tcp://HOST:PORT or tls://, or "
            "a scheduler file of Dask: a cluster that runs.",
            callback=checked(Annotated[str, AfterValidator(_executor_named)]),
        ),
    ] = "processes",
    processes: Annotated[
        int | None,
        option(
            "Processes of this machine. [default: as many as cores and memory allow]",
            int,
            ge=1,
            le=4096,
        ),
    ] = None,
    memory_gb: Annotated[
        float | None, option("Memory that a task may take; one that needs more fails.", Positive)
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say tasks, hours and bytes.")
    ] = False,
    first: Annotated[int | None, option("End after so many tasks.", int, ge=1, le=10**9)] = None,
    again: Annotated[
        bool, typer.Option("--again", help="Also what failed or was set aside.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Do many independent tasks: surfaces of many people and screens, calibrations, and more.

    Leaves table.csv, report.html and the files of each task. A campaign that was stopped, however,
    goes on with the same command.
    """
    from haptix.campaign.kinds import load_campaign

    chosen = load_campaign(plan)
    where = out or chosen.name
    if dry_run:
        from haptix.campaign.run import estimate

        with _executor(on, chosen, processes, memory_gb) as executor:
            show(*estimate(chosen, where, executor), as_json)
        return
    from haptix.campaign.run import run_campaign

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C, in good order
    try:
        with _executor(on, chosen, processes, memory_gb) as executor:
            result = run_campaign(chosen, where, executor, _Say(), again, first)
    except KeyboardInterrupt:
        sys.stderr.write("haptix: stopped; finished tasks are kept, and the same command goes on\n")
        raise typer.Exit(130) from None
    for place, why in result.damaged.items():
        _warn(f"{where}/{place}: {why}; its task was done again")
    counts = ", ".join(f"{n} {status}" for status, n in result.counts.items() if n)
    title = f"{chosen.name}: {counts}, {result.reused} of them before; report: {where}/report.html"
    if as_json:
        show(title, result.rows, as_json)
        return
    rows = [row for row in result.rows if row["status"] in ("failed", "set aside")]
    show(
        title,
        [{"key": r["key"][:12], "status": r["status"], "error": r["error"]} for r in rows],
        False,
    )
    if rows:
        raise typer.Exit(1)


@contextmanager
def _executor(
    on: str, chosen: Any, processes: int | None, memory_gb: float | None
) -> Iterator[Any]:
    """Open what tasks are done on; where the body ends early, end it at once."""
    memory = None if memory_gb is None else int(memory_gb * 1e9)
    if on == "processes":
        from haptix.campaign.processes import Processes, processes_that_fit

        first = next(chosen.tasks(), None)
        needed = memory or (0 if first is None else chosen.needed_bytes(first.document))
        opened: Any = Processes(processes_that_fit(needed, processes), memory)
    else:
        from haptix.campaign.cluster import DaskWorkers

        opened = DaskWorkers.on(on, processes, memory, _warn)
    try:
        yield opened
    except BaseException:
        opened.shutdown(wait=False, cancel_futures=True)
        raise
    opened.shutdown()


def _warn(why: str) -> None:
    sys.stderr.write(f"haptix: {why}\n")


class _Say:
    """Says on stderr how far a campaign is: in place on a terminal, else now and then."""

    def __init__(self) -> None:
        self._said = -_SAY_EVERY_S

    def __call__(self, seen: Any) -> None:
        now, live = time.monotonic(), sys.stderr.isatty()
        counts = seen.counts
        is_last = not counts["waiting"]
        if now - self._said < (0.2 if live else _SAY_EVERY_S) and not is_last:
            return
        self._said = now
        text = f"{counts['done']} of {seen.total} tasks"
        for status in ("failed", "set aside"):
            text += f", {counts[status]} {status}" * bool(counts[status])
        if seen.seconds_left:
            text += f", {duration(seen.seconds_left)} left"
        sys.stderr.write(f"\r\x1b[K{text}" if live else f"{text}\n")
        if live and is_last:
            sys.stderr.write("\n")
        sys.stderr.flush()


def duration(seconds: float) -> str:
    """Return a time as people say it."""
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.2g} s"
