"""``haptix query`` and ``invert``."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from haptix.arguments import is_there, numbers, read_numbers
from haptix.cli.options import (
    Fidelity,
    Finger,
    Force,
    Frequency,
    Screen,
    Skin,
    Theory,
    Thickness,
    Voltage,
    With,
    Without,
)
from haptix.errors import LimitError
from haptix.files import reading
from haptix.terminal import (
    AsJson,
    accuracy_note,
    breakdown_note,
    placeholder_note,
    show,
    warning_note,
)

if TYPE_CHECKING:
    from haptix.friction import ContactModel
    from haptix.surface import FrictionSurface


def query(
    normal_force_n: Force,
    voltage_v: Voltage,
    frequency_hz: Frequency = None,
    h0_m: Thickness = None,
    surface: Annotated[
        Path | None,
        typer.Option(help="Read this surface instead of solving the model.", callback=is_there),
    ] = None,
    finger: Finger = "semi-wet",
    screen: Screen = "3m-sct3250",
    skin_dielectric: Skin = None,
    fidelity: Fidelity = "mean-field",
    theory: Theory = None,
    with_terms: With = None,
    without_terms: Without = None,
    as_json: AsJson = False,
) -> None:
    """Friction for a force and a voltage, from the model or from a surface."""
    from haptix.contact import shown_accuracy
    from haptix.friction import placeholder_spread
    from haptix.surface import FrictionSurface

    inputs = _product(
        normal_force_n=normal_force_n, voltage_v=voltage_v, frequency_hz=frequency_hz, h0_m=h0_m
    )
    if surface is None:
        model = model_of(
            finger, screen, skin_dielectric, fidelity, theory, with_terms, without_terms
        )
        state, spread = model.solve(**inputs), placeholder_spread(model, **inputs)
        largest = {name: float(jnd.max()) for name, jnd in spread.items()}
        note = placeholder_note(model.placeholders(), largest)
        outputs: dict[str, Any] = {
            "mu": state.mu,
            "x": state.x,
            "area_fraction": state.area_fraction,
            "attraction_pa": state.attraction_pa,
            "pull_in_voltage_v": state.pull_in_voltage_v,
            "pull_past_breakdown": state.pull_past_breakdown,
        }
        if as_json:
            outputs |= {f"{name.replace(' ', '_')}_spread_jnd": jnd for name, jnd in spread.items()}
        share = float(state.pull_past_breakdown.max())
        status, warnings = state.status, state.warnings()
        x = float(state.x.min())
        note += accuracy_note(x, shown_accuracy(model.theory, x))
    else:
        table = FrictionSurface.load(surface)
        with reading(surface, "a surface with its model"):
            limit = float(table.info["model"]["screen"]["max_voltage_v"])
        highest = float(inputs["voltage_v"].max())
        if highest > limit:
            raise LimitError(
                f"voltage_v: {highest:g} V is above the limit of {limit:g} V of the "
                "surface's screen; lower it (it is rejected, not clamped)"
            )
        sample, note = table.evaluate(**inputs), note_of(table, surface)
        outputs, status, warnings = {"mu": sample.mu}, sample.status, []
        # Surfaces of earlier versions do not know.
        share = float(table.info.get("pull_past_breakdown", 0.0))
    title = f"friction at the period's mean attraction{note}"
    title += breakdown_note(share) + warning_note(warnings)
    show(title, _rows(inputs, outputs, status), as_json)


def invert(
    surface: Annotated[
        Path, typer.Argument(help="Surface made by `haptix build`.", callback=is_there)
    ],
    mu: Annotated[
        str, typer.Option(help="Friction coefficients, comma-separated.", callback=numbers())
    ],
    normal_force_n: Force,
    frequency_hz: Frequency = None,
    h0_m: Thickness = None,
    as_json: AsJson = False,
) -> None:
    """Voltage for a friction, with the status of each: OK, BELOW, ABOVE, PULL_IN."""
    from haptix.surface import FrictionSurface

    inputs = _product(mu=mu, normal_force_n=normal_force_n, frequency_hz=frequency_hz, h0_m=h0_m)
    table = FrictionSurface.load(surface)
    found = table.voltage(**inputs)
    title = f"voltage{note_of(table, surface)}"
    show(title, _rows(inputs, {"voltage_v": found.voltage_v}, found.status), as_json)


def note_of(table: FrictionSurface, file: Path) -> str:
    """Return what a title says about the placeholders of a surface."""
    with reading(file, "a surface with its model"):
        placeholders = [str(one) for one in table.info["model"]["placeholders"]]
        # A surface of an earlier version, or one made in Python, does not have it.
        spread = table.info.get("notes", {}).get("placeholder_spread_jnd", {})
        return placeholder_note(placeholders, {str(k): float(v) for k, v in spread.items()})


def model_of(
    finger: str,
    screen: str,
    skin_dielectric: str | None,
    fidelity: str,
    theory: str | None,
    with_terms: list[str] | None,
    without_terms: list[str] | None,
) -> ContactModel:
    """Return the contact model that the options describe."""
    from haptix.finger import Finger
    from haptix.friction import ContactModel
    from haptix.screen import Screen

    chosen = Finger.named(finger)
    if skin_dielectric is not None:
        chosen = chosen.replace(dielectric=skin_dielectric)
    return ContactModel(
        chosen,
        Screen.named(screen),
        fidelity=fidelity,  # type: ignore[arg-type]  # checked by the model
        theory=theory,  # type: ignore[arg-type]
        terms=dict.fromkeys(with_terms or [], True) | dict.fromkeys(without_terms or [], False),
    )


def option_of(name: str) -> str:
    """Return the option of a parameter."""
    return f"--{name.replace('_', '-')}"


def _product(**options: str | None) -> dict[str, Any]:
    """Every combination of the options' numbers, one row each; an option left out stays None."""
    import torch

    given = {
        name: read_numbers(option_of(name), text)
        for name, text in options.items()
        if text is not None
    }
    columns = torch.tensor(list(product(*given.values())), dtype=torch.float64).T
    return dict.fromkeys(options) | dict(zip(given, columns, strict=True))


def _rows(inputs: dict[str, Any], outputs: dict[str, Any], status: Any) -> list[dict[str, Any]]:
    from haptix.status import Status

    columns = {name: column for name, column in (inputs | outputs).items() if column is not None}
    return [
        {name: float(column[row]) for name, column in columns.items()}
        | {"status": Status(int(status[row])).name}
        for row in range(len(status))
    ]
