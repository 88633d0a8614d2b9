"""The task that runs a campaign: it does other tasks on many processes or machines."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, Field

from haptix.base.fields import Argument, FileThere, Local, Positive, Text, folder, is_there, one_of
from haptix.base.task import CancelledError, Context, Result, Task

if TYPE_CHECKING:
    from haptix.tasks.campaign import Campaign, CampaignResult

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


class StoppedError(CancelledError):
    """A person has stopped a campaign."""

    exit_code = 130


class RunCampaign(Task, command="campaign"):
    """Do many independent tasks: surfaces of many people and screens, calibrations, and more.

    Leaves table.csv, report.html and the files of each task. A campaign that was stopped, however,
    goes on with the same command.
    """

    plan: Annotated[FileThere, Argument] = Field(description="Campaign: a TOML file.")
    out: Annotated[Text, AfterValidator(_folder_or_url), Local()] | None = Field(
        None,
        description="Folder, or a URL of fsspec such as s3://bucket/name. [default: the plan's "
        "name]",
    )
    on: Annotated[str, AfterValidator(_executor_named), Local()] = Field(
        "processes",
        description="processes: of this machine; dask: a local cluster; tcp://HOST:PORT or "
        "tls://, or a scheduler file of Dask: a running cluster.",
    )
    processes: Annotated[int, Field(ge=1, le=4096)] | None = Field(
        None, description="Processes of this machine. [default: as many as cores and memory allow]"
    )
    memory_gb: Positive | None = Field(
        None, description="Memory that a task may take; one that needs more fails."
    )
    dry_run: bool = Field(False, description="Only print tasks, hours and bytes.")
    first: Annotated[int, Field(ge=1, le=10**9)] | None = Field(
        None, description="End after so many tasks."
    )
    again: bool = Field(False, description="Also repeat tasks that failed or were set aside.")

    def run(self, context: Context) -> Result:
        """Run the campaign, or estimate its costs."""
        from haptix.tasks.campaign.plans import load_campaign
        from haptix.tasks.campaign.run import estimate, run_campaign

        plan = load_campaign(self.plan)
        where = self.out or plan.name
        if self.dry_run:
            with self._executor(plan, context) as executor:
                title, rows = estimate(plan, where, executor)
            return Result(rows, [(title, rows)])
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends like Ctrl-C
        progress = partial(_progress, context, [time.monotonic()])
        try:
            with self._executor(plan, context) as executor:
                result = run_campaign(plan, where, executor, progress, self.again, self.first)
        except KeyboardInterrupt:
            raise StoppedError(
                "stopped; finished tasks are kept, and the same command goes on"
            ) from None
        for place, why in result.damaged.items():
            context.tell(step=f"{where}/{place}: {why}; its task was done again")
        title = f"{plan.name}: {result.verdict}; report: {where}/report.html"
        wrong = result.failures
        return Result([*result.rows], [(title, wrong)], failed=bool(wrong))

    @contextmanager
    def _executor(self, plan: Campaign, context: Context) -> Iterator[Any]:
        """Open the executor of the tasks; if the body ends early, end it at once."""
        memory = None if self.memory_gb is None else int(self.memory_gb * 1e9)
        if self.on == "processes":
            from haptix.tasks.campaign.processes import Processes, processes_that_fit

            first = next(plan.tasks(), None)
            needed = memory or (0 if first is None else first.task.needed_bytes)
            opened: Any = Processes(processes_that_fit(needed, self.processes), memory)
        else:
            from haptix.tasks.campaign.cluster import DaskWorkers

            opened = DaskWorkers.on(
                self.on, self.processes, memory, lambda why: context.tell(step=why)
            )
        try:
            yield opened
        except BaseException:
            opened.shutdown(wait=False, cancel_futures=True)
            raise
        opened.shutdown()


def _progress(context: Context, reported_s: list[float], so_far: CampaignResult) -> None:
    """Report the progress of a campaign; without a bar, as in a cluster's log, in lines."""
    done = so_far.total - so_far.counts["waiting"]
    context.progress("tasks", done / so_far.total)
    now_s = time.monotonic()
    if sys.stderr.isatty() or (now_s - reported_s[0] < _SAY_EVERY_S and so_far.counts["waiting"]):
        return
    reported_s[0] = now_s
    text = f"{so_far.counts['done']} of {so_far.total} tasks"
    for status in ("failed", "set aside"):
        text += f", {so_far.counts[status]} {status}" * bool(so_far.counts[status])
    if so_far.seconds_left:
        text += f", {so_far.seconds_left / 60:.3g} min left"
    context.tell(step=text)
