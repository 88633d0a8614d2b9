"""What a campaign will cost, from tasks of it that were measured."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from haptix.campaign.kinds import Campaign
from haptix.campaign.ledger import Ledger
from haptix.campaign.run import run_campaign
from haptix.campaign.store import store_at
from haptix.errors import HaptixError

PILOTS = 2
"""Tasks that are done where none was measured yet; their results are kept."""


def estimate(
    campaign: Campaign, where: str | Path, executor: Any = None
) -> tuple[str, list[dict[str, Any]]]:
    """Return a sentence and a row about tasks, hours and bytes, from the tasks done so far.

    Where there are none, the first `PILOTS` are done.

    Raises
    ------
    HaptixError
        If none of these has a result; the message has the reason of the first.
    """
    ledger = Ledger.of(store_at(where), campaign)
    if not ledger.counts["done"]:
        run_campaign(campaign, where, executor, most=PILOTS)
        ledger = Ledger.of(store_at(where), campaign)
    table = ledger.table()
    done = [row for row in table if row["status"] == "done" and row["seconds"] is not None]
    if not done:
        why = next((row["error"] for row in table if row["error"]), "there are none")
        raise HaptixError(f"{campaign.name}: no task could be measured: {why}")
    waiting = ledger.counts["waiting"]
    seconds, cpu_seconds, size = (
        sum(float(row[name] or 0) for row in done) / len(done)
        for name in ("seconds", "cpu_seconds", "bytes")
    )
    at_once = getattr(executor, "workers", 1)
    row = {
        "tasks": len(table),
        "done": ledger.counts["done"],
        "seconds_each": seconds,
        "hours_left": waiting * seconds / at_once / 3600,
        "cpu_hours_left": waiting * cpu_seconds / 3600,  # whatever else the machine did
        "at_once": at_once,
        "bytes_left": round(waiting * size),
        "bytes_in_all": round(len(table) * size),
    }
    return f"{campaign.name}: from the costs of {len(done)} tasks, kept in {where}", [row]
