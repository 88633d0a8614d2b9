"""The table of a campaign: every task with its status, its numbers and its costs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from haptix.campaign.kinds import Campaign, Value
from haptix.campaign.store import MANIFEST, Store, folder_of, record_of
from haptix.files import csv_text

_LAST = ("status", "seconds", "cpu_seconds", "peak_bytes", "bytes", "worker", "deaths", "error")


@dataclass
class Ledger:
    """What is known of every task, by its key.

    Parameters
    ----------
    rows : dict
        Rows of the table in the order of the plan.
    """

    rows: dict[str, dict[str, Value]] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    """Tasks by status."""

    @classmethod
    def of(cls, store: Store, campaign: Campaign, again: bool = False) -> Ledger:
        """Read what a place has of a campaign.

        Parameters
        ----------
        store : Store
            The place.
        campaign : Campaign
            The plan.
        again : bool
            Forget what failed or was set aside.
        """
        ledger, done = cls(), store.finished()
        for task in campaign.tasks():
            key = task.key
            if key in ledger.rows:
                continue
            ledger.rows[key] = {**task.labels, "status": "waiting"}
            ledger.counts["waiting"] += 1
            record = store.read_table(record_of(key)) or {}
            if key in done and (result := store.read_table(f"{folder_of(key)}/{MANIFEST}")):
                ledger.enter(key, {**record, "status": "done", "error": "", "row": result["row"]})
            elif record.get("status") in ("failed", "set aside"):
                if again:
                    store.write_table(record_of(key), {"status": "stopped"})
                else:
                    ledger.enter(key, record)
        return ledger

    def take(self, key: str) -> bool:
        """Whether a task is to be done; asked once of each."""
        row = self.rows[key]
        if row["status"] != "waiting":
            return False
        self._count(row, "in work")
        return True

    def let_go(self) -> None:
        """What was taken and has not ended waits again."""
        for row in self.rows.values():
            if row["status"] == "in work":
                self._count(row, "waiting")

    def enter(self, key: str, record: Mapping[str, Any]) -> None:
        """Keep how a task ended."""
        row = self.rows[key]
        row.update(record.get("row", {}))
        for name, value in record.items():
            if name not in ("row", "status"):
                row[name] = len(value) if isinstance(value, list) else value
        self._count(row, record["status"])

    def _count(self, row: dict[str, Value], status: str) -> None:
        self.counts[str(row["status"])] -= 1
        self.counts[status] += 1
        row["status"] = status

    def table(self) -> list[dict[str, Value]]:
        """Return the rows with the same columns in each: labels, numbers, status, costs, key."""
        names = dict.fromkeys(name for row in self.rows.values() for name in row)
        columns = [*(name for name in names if name not in _LAST), *_LAST]
        return [
            {**{name: row.get(name) for name in columns}, "key": key}
            for key, row in self.rows.items()
        ]

    def csv(self) -> str:
        """Return the table as CSV."""
        table = self.table()
        names = table[0] if table else ("status",)
        return csv_text(names, (row.values() for row in table))
