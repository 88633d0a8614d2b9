"""``haptix build``, ``query`` and ``invert``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from haptix.cli.output import AsJson, progress_bar, show

if TYPE_CHECKING:
    from torch import Tensor

    from haptix.friction import ContactModel

Finger = Annotated[str, typer.Option(help="Finger: a preset (dry, semi-wet, wet) or a TOML file.")]
Screen = Annotated[str, typer.Option(help="Screen: a preset (3m-sct3250) or a TOML file.")]
Fidelity = Annotated[str, typer.Option(help="mean-field, or closed-form: faster and coarser.")]
With = Annotated[
    list[str] | None,
    typer.Option("--with", help="Switch a term on, such as finite-size; may be repeated."),
]
Without = Annotated[
    list[str] | None, typer.Option("--without", help="Switch a term off; may be repeated.")
]
Force = Annotated[str, typer.Option(help="Normal forces [N], comma-separated.")]
Voltage = Annotated[str, typer.Option(help="Amplitudes [V], comma-separated.")]
Frequency = Annotated[
    str | None,
    typer.Option(help="Drive frequencies [Hz]; without, the skin counts as a conductor."),
]
Thickness = Annotated[
    str | None, typer.Option(help="d1/eps1 of the insulator [m]. [default: the screen's own]")
]


def build(
    out: Annotated[Path, typer.Argument(help="File to write, such as my.surface.")],
    finger: Finger = "semi-wet",
    screen: Screen = "3m-sct3250",
    normal_force_n: Annotated[
        str, typer.Option(help="Range of normal force [N]: LOW,HIGH or one value.")
    ] = "0.1,1",
    voltage_v: Annotated[
        float | None, typer.Option(help="Highest amplitude [V]. [default: the screen's limit]")
    ] = None,
    frequency_hz: Annotated[
        str | None,
        typer.Option(help="Drive frequency [Hz]: LOW,HIGH or one; without, the skin conducts."),
    ] = None,
    h0_m: Annotated[
        str | None, typer.Option(help="Range of d1/eps1 [m]. [default: the screen's own]")
    ] = None,
    tolerance: Annotated[float, typer.Option(help="Largest error in mu.")] = 2e-3,
    overwrite: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
    fidelity: Fidelity = "mean-field",
    with_terms: With = None,
    without_terms: Without = None,
    as_json: AsJson = False,
) -> None:
    """Solve the contact model once and write its friction surface."""
    from haptix.cli.numbers import read_pair
    from haptix.errors import InputError
    from haptix.surface import FrictionSurface

    if out.exists() and not overwrite:
        raise InputError(f"{out} exists: name another file, or pass --overwrite to replace it")
    if out.is_dir() or not _makeable(out.absolute().parent):
        raise InputError(f"{out}: expected a file in a folder that can be made")
    model = _model(finger, screen, fidelity, with_terms, without_terms)
    scene: dict[str, Any] = {"normal_force_n": read_pair("normal-force-n", normal_force_n)}
    if voltage_v is not None:
        scene["voltage_v"] = (0.0, voltage_v)
    if frequency_hz is not None:
        scene["frequency_hz"] = read_pair("frequency-hz", frequency_hz)
    if h0_m is not None:
        scene["h0_m"] = read_pair("h0-m", h0_m)
    with progress_bar({"build": "build the surface"}) as update:
        surface = FrictionSurface.build(
            model, scene, tolerance, lambda share: update("build", share)
        )
    surface.save(out)
    rows = [
        {
            "file": str(out),
            "values": surface.mu_table.numel(),
            "bytes": out.stat().st_size,
            "mu_low": float(surface.mu_table.min()),
            "mu_high": float(surface.mu_table.max()),
            "error_max": surface.info["error_max"],
            "error_p99": surface.info["error_p99"],
            "tolerance": tolerance,
        }
    ]
    show("friction surface", rows, as_json)


def query(
    normal_force_n: Force,
    voltage_v: Voltage,
    frequency_hz: Frequency = None,
    h0_m: Thickness = None,
    surface: Annotated[
        Path | None, typer.Option(help="Read this surface instead of solving the model.")
    ] = None,
    finger: Finger = "semi-wet",
    screen: Screen = "3m-sct3250",
    fidelity: Fidelity = "mean-field",
    with_terms: With = None,
    without_terms: Without = None,
    as_json: AsJson = False,
) -> None:
    """Friction for given force and voltage, from the model or from a surface."""
    from haptix.errors import LimitError
    from haptix.surface import FrictionSurface

    force, voltage, frequency, h0 = _product(
        _tensor("normal-force-n", normal_force_n),
        _tensor("voltage-v", voltage_v),
        _tensor("frequency-hz", frequency_hz),
        _tensor("h0-m", h0_m),
    )
    inputs = {
        "normal_force_n": force,
        "voltage_v": voltage,
        "frequency_hz": frequency,
        "h0_m": h0,
    }
    if surface is None:
        state = _model(finger, screen, fidelity, with_terms, without_terms).solve(**inputs)
        outputs = {
            "mu": state.mu,
            "area_fraction": state.area_fraction,
            "attraction_pa": state.attraction_pa,
            "pull_in_voltage_v": state.pull_in_voltage_v,
        }
        status = state.status
    else:
        table = FrictionSurface.load(surface)
        limit = table.info["model"]["screen"]["max_voltage_v"]
        if float(voltage.max()) > limit:
            raise LimitError(
                f"voltage_v: {float(voltage.max()):g} V is above the limit of {limit:g} V of the "
                "surface's screen; lower it (it is rejected, not clamped)"
            )
        sample = table.evaluate(**inputs)
        outputs, status = {"mu": sample.mu}, sample.status
    show("friction", _rows(inputs, outputs, status), as_json)


def invert(
    surface: Annotated[Path, typer.Argument(help="Surface made by `haptix build`.")],
    mu: Annotated[str, typer.Option(help="Wanted friction coefficients, comma-separated.")],
    normal_force_n: Force,
    frequency_hz: Frequency = None,
    h0_m: Thickness = None,
    as_json: AsJson = False,
) -> None:
    """Voltage for a wanted friction, with the status of each: OK, BELOW, ABOVE, PULL_IN."""
    from haptix.surface import FrictionSurface

    wanted, force, frequency, h0 = _product(
        _tensor("mu", mu),
        _tensor("normal-force-n", normal_force_n),
        _tensor("frequency-hz", frequency_hz),
        _tensor("h0-m", h0_m),
    )
    found = FrictionSurface.load(surface).voltage(wanted, force, frequency, h0)
    inputs = {"mu": wanted, "normal_force_n": force, "frequency_hz": frequency, "h0_m": h0}
    show("voltage", _rows(inputs, {"voltage_v": found.voltage_v}, found.status), as_json)


def _makeable(folder: Path) -> bool:
    while not folder.exists():
        folder = folder.parent
    return folder.is_dir()


def _model(
    finger: str,
    screen: str,
    fidelity: str,
    with_terms: list[str] | None,
    without_terms: list[str] | None,
) -> ContactModel:
    from haptix.finger import Finger
    from haptix.friction import ContactModel
    from haptix.screen import Screen

    return ContactModel(
        Finger.load(finger) if finger.endswith(".toml") else Finger.preset(finger),
        Screen.load(screen) if screen.endswith(".toml") else Screen.preset(screen),
        fidelity=fidelity,  # type: ignore[arg-type]  # checked by the model
        terms=dict.fromkeys(with_terms or [], True) | dict.fromkeys(without_terms or [], False),
    )


def _tensor(option: str, text: str | None) -> Tensor | None:
    import torch

    from haptix.cli.numbers import read_numbers

    return None if text is None else torch.tensor(read_numbers(option, text), dtype=torch.float64)


def _product(*columns: Any) -> list[Any]:
    """Every combination, one row each; columns that are None stay None."""
    import torch

    given = [column for column in columns if column is not None]
    grids = iter(grid.reshape(-1) for grid in torch.meshgrid(*given, indexing="ij"))
    return [None if column is None else next(grids) for column in columns]


def _rows(inputs: dict[str, Any], outputs: dict[str, Any], status: Any) -> list[dict[str, Any]]:
    from haptix.status import Status

    columns = {name: column for name, column in (inputs | outputs).items() if column is not None}
    return [
        {name: float(column[row]) for name, column in columns.items()}
        | {"status": Status(int(status[row])).name}
        for row in range(len(status))
    ]
