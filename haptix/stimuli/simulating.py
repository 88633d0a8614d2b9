"""One simulation of an experiment, told and answered as text: here, or by workers elsewhere."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

from haptix.checks import whole
from haptix.errors import InputError
from haptix.stimuli.adaptive.tasks import TASKS
from haptix.stimuli.experiment_recipe import ExperimentRecipe
from haptix.stimuli.power import Observer, accuracy, paired_power

_ALWAYS_GUESSED = 0.05  # share of answers that find a target where the task has no chance level


def simulations(
    recipe: ExperimentRecipe,
    threshold_db: Sequence[float],
    slope: Sequence[float],
    lapse: Sequence[float],
    runs: int,
    comparison: Mapping[str, Any] | None = None,
) -> Iterator[dict[str, Any]]:
    """Yield the document of each observer, for `simulated`.

    Parameters
    ----------
    recipe : ExperimentRecipe
        The experiment; its conditions are left out.
    threshold_db, slope, lapse : sequence of float
        Of the observers: every combination.
    runs : int
        Runs of each observer, or simulated participants.
    comparison : mapping, optional
        Where the power is asked for: `difference`, `between` and the sample sizes `participants`
        of `haptix.stimuli.power.paired_power`.

    Raises
    ------
    InputError
        If the task measures no threshold.
    """
    if recipe.task in ("pairs", "magnitude"):
        raise InputError(f"simulate: the task {recipe.task!r} measures no threshold")
    recipe.model_copy(update={"conditions": ()}).make_method()  # a wrong one is refused here
    plain = recipe.model_dump(
        mode="json", include={"name", "stimulus", "pedestal", "method", "task", "seed"},
        exclude_none=True,
    )  # fmt: skip
    for at, steep, lapses in product(threshold_db, slope, lapse):
        observer = {
            "threshold": at,
            "slope": steep,
            "lapse": lapses,
            "guess": TASKS[recipe.task].guess or _ALWAYS_GUESSED,
        }
        document = {"experiment": plain, "observer": observer, "runs": whole("runs", runs, 10)}
        yield document if comparison is None else {**document, "comparison": dict(comparison)}


def simulated(text: str) -> str:
    """Simulate one observer.

    Parameters
    ----------
    text : str
        JSON of one of `simulations`.

    Returns
    -------
    str
        JSON: a list with the row of `accuracy`, or those of `paired_power`.
    """
    given = json.loads(text)
    recipe, observer = ExperimentRecipe(**given["experiment"]), Observer(**given["observer"])
    how = recipe.make_method, observer
    if (asked := given.get("comparison")) is None:
        return json.dumps([accuracy(*how, given["runs"], recipe.seed)])
    return json.dumps([*paired_power(*how, **asked, runs=given["runs"], seed=recipe.seed)])
