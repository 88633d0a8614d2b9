"""What the rows of a session say beside the thresholds: catch trials, d', exclusion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan, sqrt
from statistics import NormalDist
from typing import Any

from haptix.stimuli.adaptive.evidence import CHANCE_P, without
from haptix.stimuli.adaptive.method import Estimate
from haptix.stimuli.adaptive.session_plan import Exclude
from haptix.stimuli.adaptive.tasks import task_named

_NORMAL = NormalDist()


def summary(
    rows: Sequence[Mapping[str, str]], task: str, exclude: Exclude | None = None
) -> dict[str, Any]:
    """Return what the rows of a log say, as plain values.

    Catch trials right; of tasks that detect also the shares of hits and false alarms, d' and the
    criterion; and by which rules the session is excluded.
    """
    rules, found = exclude or Exclude(), dict[str, Any]()
    why = []
    counted = [row for row in rows if row["accepted"] == "true"]
    caught = [row for row in counted if row["kind"] == "catch"]
    if caught:
        right = sum(row["is_right"] == "true" for row in caught)
        found["catch_trials"], found["catch_right"] = len(caught), right / len(caught)
        if rules.catch_right is not None and right / len(caught) < rules.catch_right:
            why.append(f"{right} of {len(caught)} catch trials were right")
    if rows and rules.off_touch is not None:
        off = 1 - len(counted) / len(rows)
        if off > rules.off_touch:
            why.append(f"the touch was off in {off:.0%} of the attempts")
    if task_named(task).detects and caught:
        shown = [row for row in counted if row["kind"] == "trial"]
        found |= detection(
            sum(row["is_right"] == "true" for row in shown), len(shown),
            sum(row["is_right"] != "true" for row in caught), len(caught), task,
        )  # fmt: skip
    if why:
        found["excluded"] = "; ".join(why)
    return found


def found_by_chance(
    found: Estimate, rows: Sequence[Mapping[str, str]], task: str, condition: str = ""
) -> Estimate:
    """Return an estimate, without a threshold if targets were found where none was as often."""
    if not task_named(task).detects or isnan(found.threshold):
        return found
    from scipy.stats import fisher_exact

    table = [[0, 0], [0, 0]]
    for row in rows:
        if row["accepted"] == "true" and row["kind"] in ("trial", "catch"):
            is_empty = row["kind"] == "catch"
            # An empty trial that is wrong is one in which a target was found.
            was_found = (row["is_right"] == "true") != is_empty
            if is_empty or not condition or row["condition"] == condition:
                table[is_empty][not was_found] += 1
    p = float(fisher_exact(table, alternative="greater").pvalue)
    if p <= CHANCE_P:
        return found
    return without(
        found,
        f"no threshold: a target was found in {table[0][0]} of {sum(table[0])} trials with one, "
        f"and in {table[1][0]} of {sum(table[1])} without (p = {p:.2g})",
    )


def detection(
    hits: int, shown: int, false_alarms: int, empty: int, task: str = "yes-no"
) -> dict[str, float]:
    """Return the shares of hits and false alarms, d' and the criterion.

    Half an answer is added to each count (Hautus, Behav. Res. Methods 27, 46 (1995)). For
    "same-different" d' is that of an observer who compares the two (Macmillan & Creelman, Detection
    Theory, 2nd ed. (2005), ch. 9).
    """
    hit = (hits + 0.5) / (shown + 1)
    false = (false_alarms + 0.5) / (empty + 1)
    found = {"hits": hit, "false_alarms": false}
    if task != "same-different":
        z_hit, z_false = _NORMAL.inv_cdf(hit), _NORMAL.inv_cdf(false)
        return found | {"d_prime": z_hit - z_false, "criterion": -(z_hit + z_false) / 2}
    limit = -sqrt(2) * _NORMAL.inv_cdf(false / 2)

    def hits_at(d: float) -> float:
        above, below = ((limit - d) / sqrt(2), (-limit - d) / sqrt(2))
        return 1 - _NORMAL.cdf(above) + _NORMAL.cdf(below)

    low, high = 0.0, 20.0
    for _ in range(60):  # hits rise with d'
        middle = (low + high) / 2
        low, high = (middle, high) if hits_at(middle) < hit else (low, middle)
    return found | {"d_prime": low, "criterion": limit}
