"""Recipes: an experiment as a TOML file, with its set of stimuli."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import fields, replace
from functools import cached_property
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt, model_validator

from haptix.base.checks import choice
from haptix.base.documents import Document, Part
from haptix.base.errors import InputError, LimitError
from haptix.base.files import digest
from haptix.base.kinds import call, in_folder
from haptix.feel.signals.audio_files import file_hash
from haptix.feel.signals.signal import Array, Constant, Product, Signal, signal_from
from haptix.lab.experiment import (
    METHODS,
    Catch,
    Exclude,
    Experiment,
    Magnitudes,
    Method,
    MethodsByCondition,
    Practice,
    Presentation,
    SessionPlan,
    StopRules,
    StrokeRanges,
)
from haptix.lab.experiment.observer import AnswerTo
from haptix.lab.experiment.orders import BlockOrder, order_for, seed_of
from haptix.lab.experiment.session_plan import task_named
from haptix.lab.stimuli.designs import put
from haptix.lab.stimuli.recipe import Recipe
from haptix.lab.stimuli.rendering import Apparatus, Rendering
from haptix.lab.stimuli.stimulus import Stimulus, stimulus_from
from haptix.model.finger import Finger
from haptix.model.screen import Screen
from haptix.model.status import Status
from haptix.model.surface import Column
from haptix.play.devices import Device

TaskName = Literal[
    "2ifc", "2afc", "3afc", "yes-no", "same-different", "pairs", "triads", "magnitude", "sorting"
]

_COMPARES = {"pairs": "pairs", "triads": "triads", "magnitude": "magnitudes", "sorting": "sorting"}
"""Kind of the method of each task that compares levels or items."""

_SEEDED = [name for name, method in METHODS.items() if "seed" in {at.name for at in fields(method)}]

_WITHOUT_TARGET = 0.05  # share of answers that find a target where there is none
_LONGEST_NAME = 256  # of a file; a longer text names none


def _texts(value: Any) -> Iterator[str]:
    """Yield all texts within tables and lists."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | Sequence):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from _texts(part)


class ConditionTable(Part):
    """Table of a recipe: what differs in a condition."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
    set: dict[str, Any] = Field(default={})


class ExperimentRecipe(Document):
    """An experiment, read from a file."""

    name: str
    """Name of the experiment."""
    stimulus: dict[str, Any] = Field(default={})
    """A stimulus; the level multiplies its signal by ``10^(level / 20)``. Items change it."""
    method: dict[str, Any]
    """``kind`` is "up-down", "quest+" or "constant-stimuli", or one that compares: "pairs",
    "triads", "magnitudes", "sorting"; the rest are its parameters."""
    items: tuple[ConditionTable, ...] | str = ()
    """Items compared in place of levels: two or more, each with a `name`, and `set`, values at
    dotted places of the stimulus; or the file of a set, all of whose stimuli are compared."""
    pedestal: dict[str, Any] | None = None
    """A signal in the same quantity, in both target and reference, to measure a JND. Without it the
    reference is 0 V."""
    task: TaskName = "2ifc"
    """A name of `haptix.lab.TASKS`: "2ifc" in two intervals, "2afc" on the two sides of one stroke,
    "3afc", "yes-no", "same-different", "pairs", "triads", "magnitude", "sorting"."""
    finger: str = "semi-wet"
    screen: str = "3m-sct3250"
    """Presets or TOML files."""
    seed: int = 0
    pause_s: Annotated[float, Field(ge=0)] = 0.5
    ceiling_v: PositiveFloat | None = None
    conditions: tuple[ConditionTable, ...] = ()
    """Each has a `name`, and `set`: values at dotted places of stimulus, pedestal and method."""
    order: Literal["interleaved"] | BlockOrder = "interleaved"
    """"interleaved": each trial's condition is drawn; or the order of blocks, by the number of the
    participant: "williams", "latin-square", "as-listed"; or "random", drawn for each session."""
    touch: StrokeRanges = StrokeRanges()
    """Ranges of the stroke that counts, as `haptix.lab.StrokeRanges` has them."""
    practice: Practice | None = None
    catch: Catch | None = None
    stop: StopRules = StopRules()
    exclude: Exclude = Exclude()
    break_every: PositiveInt | None = None
    feedback: bool = False
    """As in `haptix.lab.SessionPlan`."""
    folder: Annotated[Path, Field(exclude=True)] = Path()

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        names = [condition.name for condition in self.conditions]
        if len(set(names)) < len(names):
            raise ValueError("conditions: expected names that differ")
        if not self.items and not self.stimulus:
            raise ValueError("stimulus: missing; an experiment needs one, or items")
        if self.items:
            wrong = [name for name in ("conditions", "pedestal", "catch") if getattr(self, name)]
            if wrong:
                raise ValueError(f"{wrong[0]}: expected none where items are compared")
            if self.task not in _COMPARES:
                raise ValueError(f"items: expected a task of {', '.join(_COMPARES)}")
            if isinstance(self.items, str) and self.stimulus:
                raise ValueError("stimulus: expected none: those of the set are compared")
        return self

    @cached_property
    def _item_stimuli(self) -> tuple[Stimulus, ...]:
        """Stimuli of the items."""
        if isinstance(self.items, str):
            return Recipe.load(self.folder / self.items).stimulus_set().stimuli
        tables = [self._tables(item, "items")["stimulus"] for item in self.items]
        with in_folder(self.folder):
            stimuli = [
                stimulus_from(item.name, table)
                for item, table in zip(self.items, tables, strict=True)
            ]
        if len({stimulus.name for stimulus in stimuli}) < len(stimuli):
            raise InputError("items: expected names that differ")
        return tuple(stimuli)

    def content_hash(self) -> str:
        """SHA-256 of all that differs from the defaults, as logs have it.

        It includes the contents of files that the recipe names, such as recordings and pictures.
        Those of finger and screen have hashes of their own in a log.
        """
        stated = self.model_dump(mode="json", exclude_defaults=True)
        files = {
            name: file_hash(path)
            for key, value in stated.items()
            if key not in ("finger", "screen")
            for name in _texts(value)
            if len(name) < _LONGEST_NAME and (path := self.folder / name).is_file()
        }
        return digest({**stated, "files": files} if files else stated)

    def session_plan(self) -> SessionPlan:
        """Return what surrounds the trials."""
        return SessionPlan(**{name: getattr(self, name) for name in SessionPlan.model_fields})

    def make_method(
        self, participant: int = 1, seed: int | None = None, square_seed: int | None = None
    ) -> Method:
        """Make the method that the table `method` describes, or that of several conditions.

        Parameters
        ----------
        participant : int
            Number from 1, which decides the order of blocks.
        seed : int, optional
            Of what is drawn in a session, in place of the recipe's; a method that states its own
            keeps it.
        square_seed : int, optional
            Of what participants share in a session, in place of the recipe's: the squares by which
            magnitudes of items are balanced over them.
        """
        if not self.conditions:
            squares = participant, self.seed if square_seed is None else square_seed
            return self._method(self._tables(None), seed, squares=squares)
        methods = {
            condition.name: self._method(self._tables(condition), seed, condition.name)
            for condition in self.conditions
        }
        drawn_by = self.seed if seed is None else seed
        if self.order == "interleaved":
            return MethodsByCondition(methods, seed=drawn_by)
        names = order_for(list(methods), participant, self.order, drawn_by)
        return MethodsByCondition({name: methods[name] for name in names}, interleaved=False)

    def experiment(
        self,
        device: Device,
        answer: AnswerTo,
        log_file: str | Path,
        number: int = 1,
        seed: int | None = None,
        square_seed: int | None = None,
        **around: Any,
    ) -> Experiment:
        """Return the experiment on a device; `around` are other parameters of `Experiment`.

        `number` (the participant's), `seed` and `square_seed` are those of `make_method`.
        """
        return Experiment(
            self.make_method(number, seed, square_seed),
            self.presentations(device.capabilities.sample_rate_hz),
            device,
            answer,
            log_file,
            self.task,
            self.seed if seed is None else seed,
            self.ceiling_v,
            self.pause_s,
            plan=self.session_plan(),
            normal_force_n=self.touch.normal_force_n,
            speed_mm_per_s=self.touch.speed_mm_per_s,
            **around,
        )

    def presentation(self, sample_rate_hz: float) -> Presentation:
        """Build the surface, and return the presentation that turns a level into volts."""
        if self.items:
            return self._presentation_of_items(sample_rate_hz)
        return self._presentation(self._tables(None), sample_rate_hz)

    def presentations(self, sample_rate_hz: float) -> Presentation | dict[str, Presentation]:
        """Return the presentation of each condition; without conditions the one."""
        if not self.conditions:
            return self.presentation(sample_rate_hz)
        return {
            condition.name: self._presentation(self._tables(condition), sample_rate_hz)
            for condition in self.conditions
        }

    def _tables(
        self, condition: ConditionTable | None, among: str = "conditions"
    ) -> dict[str, Any]:
        names = ("stimulus", "pedestal", "method")
        tables = deepcopy({name: getattr(self, name) for name in names})
        if condition is None:
            return tables
        place = f"{among}.{condition.name}.set"
        for dotted, value in condition.set.items():
            known = names if among == "conditions" else ("stimulus",)
            if dotted.split(".")[0] not in known:
                raise InputError(
                    f"{place}.{dotted}: expected a place that begins with {' or '.join(known)}, "
                    "such as stimulus.signal.frequency_hz"
                )
            put(tables, dotted, value, place)
        return tables

    def _method(
        self,
        tables: Mapping[str, Any],
        seed: int | None,
        condition: str = "",
        squares: tuple[int, int] = (1, 0),
    ) -> Method:
        table, task = dict(tables["method"]), task_named(self.task)
        if (kind := _COMPARES.get(self.task)) != table.get("kind") and (
            kind or table.get("kind") in _COMPARES.values()
        ):
            takes = repr(kind) if kind else "a method that measures a threshold"
            raise InputError(
                f"method.kind: the task {self.task!r} takes {takes}, got {table.get('kind')!r}"
            )
        if self.items:
            names = [stimulus.name for stimulus in self._item_stimuli]
            table |= {"levels": [*range(len(names))], "items": names}
            if kind == "magnitudes":
                participant, square_seed = squares
                first = (participant - 1) * table.get("repeats", Magnitudes.repeats)
                table = {"first_row": first, "square_seed": square_seed} | table
        if kind is None and task.guess != 0.5 and table.get("function") != "symmetric-normal":
            table.setdefault("guess", task.guess or _WITHOUT_TARGET)
        if table.get("kind") in _SEEDED:
            if seed is not None:
                table.setdefault("seed", seed)
            if condition:  # each has an order of its own
                table["seed"] = seed_of(table.get("seed", 0), condition)
        kind = choice("method.kind", table.pop("kind", None), METHODS)
        settings = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in table.items()
        }
        return call(f"method {kind}", METHODS[kind], settings)

    def _presentation_of_items(self, sample_rate_hz: float) -> Presentation:
        stimuli = self._item_stimuli
        finger, screen = self._touched()
        apparatus = Apparatus.build(finger, screen, stimuli, self.ceiling_v)
        made = presentation_of_items(stimuli, apparatus, sample_rate_hz)
        return self._identified(made, apparatus, stimuli, finger, screen)

    def _touched(self) -> tuple[Finger, Screen]:
        return Finger.named(self.finger, self.folder), Screen.named(self.screen, self.folder)

    def _presentation(self, tables: Mapping[str, Any], sample_rate_hz: float) -> Presentation:
        with in_folder(self.folder):
            stimulus = stimulus_from("target", tables["stimulus"])
            below = tables["pedestal"]
            pedestal = None if below is None else signal_from(below, "pedestal")
        finger, screen = self._touched()
        apparatus = Apparatus.build(finger, screen, [stimulus], self.ceiling_v)
        response, _ = apparatus.responses(stimulus)
        made = presentation_of(stimulus, response, sample_rate_hz, pedestal)
        return self._identified(made, apparatus, [stimulus], finger, screen)

    def _identified(
        self,
        made: Presentation,
        apparatus: Apparatus,
        stimuli: Sequence[Stimulus],
        finger: Finger,
        screen: Screen,
    ) -> Presentation:
        hashes = {
            "finger": finger.content_hash(),
            "screen": screen.content_hash(),
            "recipe": self.content_hash(),
        }
        return replace(
            made,
            identity={**made.identity, **hashes},
            warnings=[line for each in stimuli for line in apparatus.contact(each).warnings],
            profile=f"{finger.name} on {screen.name} {digest(hashes)[:12]}",
        )


def presentation_of(
    stimulus: Stimulus, response: Column, sample_rate_hz: float, pedestal: Signal | None = None
) -> Presentation:
    """Return the presentation of a stimulus, whose level [dB] scales its signal.

    The signal, in contrast or volts, is multiplied by ``10^(level / 20)``. The pedestal is added to
    the target; alone it is the reference. A level that asks for more friction than is reachable
    counts as above every ceiling.
    """
    if stimulus.quantity not in ("contrast", "volts"):
        raise InputError(
            f'{stimulus.name}: a level in dB cannot scale a signal in "{stimulus.quantity}"; use '
            '"contrast"'
        )
    rate, unit = sample_rate_hz, stimulus.signal
    ground = Constant(0.0) if pedestal is None else pedestal
    plain = Rendering(stimulus, response, rate)
    values = unit.values(0, plain.samples, rate)
    below = ground.values(0, plain.samples, rate)

    def scale(level: float) -> float:
        return float(10 ** (level / 20))

    def drive(signal: Signal) -> Array:
        return Rendering(replace(stimulus, signal=signal), response, rate).whole()

    def target(level: float) -> Array:
        return drive(ground.lasting(unit.length_s) + Product((Constant(scale(level)), unit)))

    def peak(level: float) -> float:
        total = below + scale(level) * values
        if stimulus.quantity == "volts":
            return float(np.abs(total).max())
        mu = (1 + total) * response.lowest_mu
        volts, status = response.voltage(mu)
        if (status == Status.BELOW).any():
            raise InputError(
                f"{stimulus.name}: asks for friction below that without voltage at level "
                f"{level:g}; raise its offset or the pedestal"
            )
        return inf if (status == response.ends_by).any() else float(volts.max())

    reference = drive(ground.lasting(unit.length_s))
    described = {
        "stimulus": stimulus.describe(),
        "pedestal": None if pedestal is None else pedestal.describe(),
        "sample_rate_hz": rate,
    }
    identity = digest(_by_content(described))
    return Presentation(target, reference, peak, {"stimulus": identity})


def presentation_of_items(
    stimuli: Sequence[Stimulus], apparatus: Apparatus, sample_rate_hz: float
) -> Presentation:
    """Return the presentation of a set, whose levels are the numbers of its stimuli.

    Each is rendered at once, as for the files of a set. Raises `LimitError` if the friction of one
    is not reachable.
    """
    drives = []
    for stimulus in stimuli:
        response, _ = apparatus.responses(stimulus)
        blocks = [*Rendering(stimulus, response, sample_rate_hz, apparatus.skin(stimulus)).stream()]
        if missed := sum(block.below + block.above for block in blocks):
            raise LimitError(
                f"{stimulus.name}: asks in {missed} samples for friction that is not reachable, "
                f"{response.lowest_mu:.3g} to {response.highest_mu:.3g}; lower its contrast"
            )
        drives.append(np.concatenate([block.drive_v for block in blocks]))
    described = [stimulus.describe() for stimulus in stimuli]
    identity = digest(_by_content({"items": described, "sample_rate_hz": sample_rate_hz}))
    return Presentation(
        lambda level: drives[int(level)],
        np.zeros(1),
        lambda level: float(np.abs(drives[int(level)]).max()),
        {"stimulus": identity},
        items=[stimulus.name for stimulus in stimuli],
    )


def _by_content(value: Any) -> Any:
    """Leave out the paths of recordings: their hash identifies them."""
    if isinstance(value, Mapping):
        at = {"file"} if value.get("sha256") else set()
        return {name: _by_content(part) for name, part in value.items() if name not in at}
    return [_by_content(item) for item in value] if isinstance(value, list | tuple) else value
