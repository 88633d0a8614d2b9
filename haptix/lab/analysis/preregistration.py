"""Preregistration: design, exclusions, test and power, written down before the first session."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING, Any, Self

from pydantic import Field, PositiveInt

from haptix.base.documents import Document
from haptix.base.files import digest
from haptix.base.version import __version__
from haptix.lab.experiment.methods import DRAWN
from haptix.lab.experiment.session_plan import Exclude
from haptix.lab.experiment.trial_log import LoggedSession

if TYPE_CHECKING:
    from haptix.lab.experiment.recipe import ExperimentRecipe

NAME = "preregistration.json"
"""Of the file, in the folder ``code`` of a study."""

TEST = (
    "hierarchical model of all participants and conditions, of the likelihood of each threshold, "
    "those beyond the levels included; differences of conditions two-sided at 0.05, p corrected by "
    "Holm; fast guesses by the mixture of reaction times of haptix.lab.experiment.fast_guesses"
)


class Preregistration(Document):
    """The statements of a study before its data.

    Parameters
    ----------
    name, task : str
        Of the experiment.
    method : mapping
        As `Method.describe` has it, without the draws of each session.
    exclude : Exclude
        Rules by which a session is left out.
    recipe : str
        Hash of the whole recipe, as logs have it: stimulus, touch, practice, catch trials, stop.
    participants : int
        How many are planned.
    test : str
        How conditions are compared.
    power : sequence of mapping
        Rows of `paired_power`, with what they assume.
    seed : int
        Of the recipe.
    written_on : date
        Day.
    made_by : str
        Version of haptix.
    content_hash : str
        SHA-256 of everything else.
    """

    name: str
    task: str
    method: dict[str, Any]
    exclude: Exclude
    recipe: str
    participants: PositiveInt
    test: str = TEST
    power: tuple[dict[str, Any], ...] = ()
    seed: int
    written_on: date
    made_by: str = __version__
    content_hash: str = Field(default="")

    @classmethod
    def of(
        cls, recipe: ExperimentRecipe, participants: int, power: Sequence[Mapping[str, Any]] = ()
    ) -> Self:
        """State a recipe.

        Parameters
        ----------
        recipe : ExperimentRecipe
            The experiment.
        participants : int
            How many are planned.
        power : sequence of mapping
            Rows of `paired_power`.
        """
        stated = cls(
            name=recipe.name, task=recipe.task, method=_undrawn(recipe.make_method().describe()),
            exclude=recipe.exclude, recipe=recipe.content_hash(), participants=participants,
            power=tuple(dict(row) for row in power), seed=recipe.seed,
            written_on=datetime.now(UTC).date(),
        )  # fmt: skip
        return stated.replace(content_hash=stated.own_hash())

    def own_hash(self) -> str:
        """Hash of all fields but the hash itself."""
        return digest(self.model_dump(mode="json", exclude={"content_hash"}))

    def deviations(self, sessions: Sequence[LoggedSession]) -> Iterator[str]:
        """Yield what of some sessions, and of this file, is not as stated."""
        if self.content_hash != self.own_hash():
            yield "the file was changed since it was written"
        people = {one.participant for one in sessions if one.source != "simulated"}
        if len(people) != self.participants:
            yield (
                f"{len(people)} participants but simulated ones, and {self.participants} were "
                "stated"
            )
        if self.test != TEST:
            yield "this version of haptix has another test"
        stated = self.model_dump(mode="json")
        for one in sessions:
            plan = one.settings.get("plan", {})
            found = {
                "task": one.settings["task"],
                "method": _undrawn(one.settings["method"]),
                "exclude": Exclude(**plan.get("exclude", {})).model_dump(mode="json"),
            }
            wrong = [name for name, value in found.items() if digest(value) != digest(stated[name])]
            if {part.get("recipe") for part in _hashes(one.settings)} != {self.recipe}:
                wrong.append("recipe")
            if wrong:
                named = " and ".join(filter(None, (", ".join(wrong[:-1]), wrong[-1])))
                yield f"{one.name}: another {named} than stated"
            days = [row["date"][:10] for row in one.rows if row["date"] != "n/a"]
            if days and date.fromisoformat(min(days)) < self.written_on:
                yield f"{one.name}: began before it was stated, on {min(days)}"


def _hashes(settings: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Hashes of the presentation, or of that of each condition."""
    hashes = settings.get("hashes", {})
    of_conditions = [part for part in hashes.values() if isinstance(part, Mapping)]
    return of_conditions or [hashes]


def _undrawn(method: Mapping[str, Any]) -> dict[str, Any]:
    """Description of a method without seeds and orders, those of its conditions included."""
    kept = {name: value for name, value in method.items() if name not in DRAWN}
    if "methods" in kept:
        parts = sorted(kept["methods"].items())
        kept["methods"] = {name: _undrawn(part) for name, part in parts}
    return kept
