"""An experiment as a TOML file: the stimulus whose level varies, the method and the task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, PositiveFloat

from haptix.documents import Document
from haptix.errors import InputError
from haptix.finger import Finger
from haptix.materials.material import in_folder
from haptix.screen import Screen
from haptix.signals.described import read
from haptix.signals.signal import Array, Constant, Product, Signal, signal_from
from haptix.status import Status
from haptix.stimuli.adaptive import METHODS, Method, Presentation
from haptix.stimuli.apparatus import Apparatus
from haptix.stimuli.rendering import Rendering
from haptix.stimuli.stimulus import Stimulus, stimulus_from
from haptix.surface import Column
from haptix.surface.request import digest


class ExperimentRecipe(Document):
    """An experiment, read from a file.

    Parameters
    ----------
    name : str
        Name of the experiment.
    stimulus : table
        A stimulus; the level multiplies its signal by ``10^(level / 20)``.
    pedestal : table, optional
        A signal in the same quantity, in both target and reference, to measure a JND.
        Without it the reference is 0 V.
    method : table
        ``kind`` is "up-down", "quest+" or "constant-stimuli"; the rest are its parameters.
    task : {"2ifc", "2afc"}
        In two intervals, or on the two sides of one stroke.
    finger, screen : str
        Presets or TOML files.
    """

    name: str
    stimulus: dict[str, Any]
    method: dict[str, Any]
    pedestal: dict[str, Any] | None = None
    task: Literal["2ifc", "2afc"] = "2ifc"
    finger: str = "semi-wet"
    screen: str = "3m-sct3250"
    seed: int = 0
    pause_s: Annotated[float, Field(ge=0)] = 0.5
    ceiling_v: PositiveFloat | None = None
    folder: Annotated[Path, Field(exclude=True)] = Path()

    @classmethod
    def _from_table(cls, fields: dict[str, Any], folder: Path) -> Self:
        if "folder" in fields:
            raise InputError("ExperimentRecipe.folder: a file has none; paths start where it lies")
        return cls(**fields, folder=folder)

    def make_method(self) -> Method:
        """Make the adaptive method that the table `method` describes."""
        return read(self.method, "method", METHODS)

    def presentation(self, sample_rate_hz: float) -> Presentation:
        """Build the surface, and return the presentation that turns a level into volts."""
        with in_folder(self.folder):
            stimulus = stimulus_from("target", self.stimulus)
        finger = Finger.named(self.finger, self.folder)
        screen = Screen.named(self.screen, self.folder)
        apparatus = Apparatus.build(finger, screen, [stimulus], self.ceiling_v)
        response, _ = apparatus.responses(stimulus)
        pedestal = None if self.pedestal is None else signal_from(self.pedestal, "pedestal")
        made = presentation_of(stimulus, response, sample_rate_hz, pedestal)
        found = {
            "finger": finger.content_hash(),
            "screen": screen.content_hash(),
            "recipe": digest(self.model_dump(mode="json")),
        }
        return replace(
            made,
            identity={**made.identity, **found},
            profile=f"{finger.name} on {screen.name} {digest(found)[:12]}",
        )


def presentation_of(
    stimulus: Stimulus,
    response: Column,
    sample_rate_hz: float,
    pedestal: Signal | None = None,
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
    asked = digest(_by_content(described))
    return Presentation(target, reference, peak, {"stimulus": asked})


def _by_content(value: Any) -> Any:
    """Leave out where recordings lie: their hash says what they are."""
    if isinstance(value, Mapping):
        at = {"file"} if value.get("sha256") else set()
        return {name: _by_content(one) for name, one in value.items() if name not in at}
    return [_by_content(one) for one in value] if isinstance(value, list | tuple) else value
