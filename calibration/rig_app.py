"""``haptix calibrate rig``: a known weight, a tap and a voltmeter, before the strokes."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from haptix.desk import argument, option
from haptix.errors import InputError
from haptix.fields import Address, FileThere, Folder, NotNegative, Positive
from haptix.report import record
from haptix.terminal import AsJson, show

if TYPE_CHECKING:
    from calibration.rig import RigCheck


def rig(
    folder: Annotated[Path, argument("Folder of the session, or a new one.", Folder)],
    weight_n: Annotated[float, option("Force of a known weight [N]: m x 9.81.", Positive)],
    inputs: Annotated[
        Path | None, option("Channels, as TOML: the readings are recorded.", FileThere)
    ] = None,
    device: Annotated[
        str | None, option("Driver, such as usb:, that plays for a voltmeter.", Address)
    ] = None,
    normal_reading_n: Annotated[
        float | None, option("Without --inputs: the weight on the screen, less zero.", float)
    ] = None,
    tangential_reading_n: Annotated[
        float | None, option("The weight that pulls towards growing x, less zero.", float)
    ] = None,
    monitor_v: Annotated[
        float | None, option("Amplitude that the recordings show or the driver plays.", NotNegative)
    ] = None,
    voltmeter_v: Annotated[
        float | None, option("Amplitude on the screen by another instrument.", NotNegative)
    ] = None,
    tap: Annotated[
        Path | None, option("CSV file of a tap: columns t_s, tangential_force_n.", FileThere)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check gain, sign and unit of both forces, the sensor's bandwidth, and the volts.

    Writes rig.toml, which `fit` and `verify` use: without it a verdict is provisional. Exit code 1
    if the rig has a fault.
    """
    from calibration.rig import RIG

    if inputs is not None:
        found = recorded(inputs, device, weight_n)
    else:
        found = stated(
            weight_n, normal_reading_n, tangential_reading_n, monitor_v, voltmeter_v, tap
        )
    folder.mkdir(parents=True, exist_ok=True)
    found.save(folder / RIG)
    names = "normal_gain", "tangential_gain", "voltage_gain", "pole_hz", "resonance_hz", "quality"
    show(str(folder / RIG), [record(found, names)], as_json)
    faults = found.faults()
    sys.stderr.writelines(f"{line}\n" for line in faults)
    if faults:
        raise typer.Exit(1)


def recorded(inputs: Path, device: str | None, weight_n: float) -> RigCheck:
    """Check a rig with its own instruments, a person and a weight."""
    from contextlib import ExitStack, closing

    from calibration.inputs import open_inputs
    from calibration.rig import measure_rig
    from firmware_io import open_device

    with ExitStack() as stack:
        driver = None if device is None else stack.enter_context(closing(open_device(device)))
        return measure_rig(open_inputs(inputs), weight_n, typer_ask, driver)


def typer_ask(prompt: str) -> str:
    """Show a prompt and return what is typed."""
    sys.stderr.write(prompt)
    sys.stderr.flush()
    return sys.stdin.readline().strip()


def stated(
    weight_n: float,
    normal_reading_n: float | None,
    tangential_reading_n: float | None,
    monitor_v: float | None,
    voltmeter_v: float | None,
    tap: Path | None,
) -> RigCheck:
    """Check a rig by readings that a person has written down."""
    from calibration.rig import RigCheck, today
    from calibration.tap import tap_response
    from haptix.files import read_csv

    readings = {
        "--normal-reading-n": normal_reading_n,
        "--tangential-reading-n": tangential_reading_n,
        "--monitor-v": monitor_v,
        "--voltmeter-v": voltmeter_v,
    }
    if missing := [name for name, one in readings.items() if one is None]:
        raise InputError(f"expected --inputs, or {', '.join(missing)} as well")
    if not (weight_n > 0 and monitor_v):
        raise InputError("--weight-n, --monitor-v: expected numbers above 0")
    normal, tangential, monitor, voltmeter = (float(one or 0.0) for one in readings.values())
    bandwidth: dict[str, float] = {}
    if tap is not None:
        import numpy as np

        names = ["t_s", "tangential_force_n"]
        try:
            rows = [[float(row.cells[name]) for name in names] for row in read_csv(tap, names)]
        except ValueError as error:
            raise InputError(f"{tap}: expected numbers, got {error}") from None
        response = tap_response(*np.array(rows).T)
        bandwidth = {name: getattr(response, name) for name in ("pole_hz", "resonance_hz")}
        bandwidth["quality"] = response.quality
    return RigCheck(
        normal_gain=normal / weight_n,
        tangential_gain=tangential / weight_n,
        voltage_gain=voltmeter / monitor,
        **bandwidth,
        instruments=(f"weight: {weight_n:g} N", "voltmeter"),
        measured_on=today(),
    )
