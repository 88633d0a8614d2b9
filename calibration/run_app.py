"""``haptix calibrate run``: all steps, one after another."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from calibration import rig_app
from calibration.fitting_app import show_verdict
from calibration.measuring_app import check_source, measure
from calibration.options import (
    Columns,
    Csv,
    FingerOption,
    Folder,
    Inputs,
    Minutes,
    PanelName,
    ScreenOption,
    Source,
    protocol_kind,
    seed_number,
)
from haptix.desk import option
from haptix.errors import InputError
from haptix.fields import Address, Positive
from haptix.files import json_text
from haptix.report import record
from haptix.terminal import AsJson, show


def run(
    folder: Folder,
    name: PanelName = None,
    source: Source = "inputs",
    device: Annotated[str | None, option("Driver, such as usb: or mock:.", Address)] = None,
    inputs: Inputs = None,
    csv: Csv = None,
    columns: Columns = None,
    protocol: Annotated[
        str, typer.Option(help="paper, full or short.", callback=protocol_kind)
    ] = "short",
    minutes: Minutes = 3.0,
    max_voltage_v: Annotated[float | None, option("Highest amplitude [V].", Positive)] = None,
    screen: ScreenOption = "3m-sct3250",
    finger: FingerOption = "semi-wet",
    operator: Annotated[str, typer.Option(help="Who measures.")] = "",
    weight_n: Annotated[
        float | None, option("Known weight [N]: the rig is checked before the strokes.", Positive)
    ] = None,
    practice: Annotated[
        bool, typer.Option("--practice", help="On a virtual finger and screen, drawn at random.")
    ] = False,
    seed: Annotated[
        int | None, typer.Option(help="Of a practice. [default: a new one]", callback=seed_number)
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not wait before each stroke.")] = False,
    as_json: AsJson = False,
) -> None:
    """Check the rig, plan, measure, reduce, fit, verify. The same command again continues it.

    Exit code 1 if strokes are still open, or the verification fails.
    """
    from secrets import randbelow

    from calibration.practice import TRUTH, VIRTUAL_RIG, compare_with_truth, draw_truth
    from calibration.profile import SCREEN
    from calibration.rig import RIG
    from calibration.session import Session
    from calibration.steps import REPORT, fit_folder, plan_strokes, reduce_folder, verify_folder
    from haptix.finger import Finger
    from haptix.screen import Screen

    source = "virtual" if practice else source
    check_source(source, csv, columns, inputs)
    own_name = "practice" if practice and name is None else name
    is_new = not (folder / "session.json").exists()
    if not is_new and practice != (folder / TRUTH).exists():
        kind = "a measured one" if practice else "a practice"
        raise InputError(f"{folder} is {kind}: choose another folder, or continue it as it began")
    if is_new:
        if own_name is None:
            raise InputError('--name: expected a name of this panel alone, such as "panel 7"')
        own_screen, own_finger = Screen.named(screen), Finger.named(finger)
        planned = plan_strokes(protocol, own_finger, own_screen, minutes, max_voltage_v).protocol
        if practice:
            drawn = randbelow(2**31) if seed is None else seed
            panel = own_screen.replace(name=own_name)
            draw_truth(own_finger, panel, planned, drawn).save(folder / TRUTH)
            VIRTUAL_RIG.save(folder / RIG)
        plan_file = folder / "plan.toml"
        planned.save(plan_file)
    if weight_n is not None and not practice and not (folder / RIG).exists():
        if inputs is None:
            raise InputError("--weight-n: expected --inputs, which read the weight")
        checked = rig_app.recorded(inputs, device, weight_n)
        if faults := checked.faults():
            raise InputError(f"the rig is not right: {'; '.join(faults)}")
        checked.save(folder / RIG)
    # What is not given again is that of the session.
    measure(
        folder,
        plan_file if is_new else None,
        source,
        device or ("mock:" if practice else None),
        screen=screen if is_new else None,
        name=own_name if is_new else name,
        finger=finger if is_new else None,
        operator=operator,
        csv=csv,
        columns=columns,
        inputs=inputs,
        resume=not is_new,
        yes=yes,
        quiet=True,
    )
    reduce_folder(folder)
    found_fit, _ = fit_folder(folder)
    found, made = verify_folder(folder)
    document: dict[str, object] = {
        **record(found),
        "strokes_used": len(found_fit.strokes),
        "h0_m": None if made is None else made.h0_m,
        "screen": None if made is None else str(folder / SCREEN),
        "report": str(folder / REPORT),
        "practice": None,
    }
    if practice and made is not None:
        highest = max(one.voltage_v for one in Session.open(folder).protocol.strokes)
        off = compare_with_truth(folder, highest)
        document["practice"] = record(off)
    if as_json:
        sys.stdout.write(json_text(document))
    else:
        show_verdict(f"{found.verdict}: {folder / REPORT}", found)
        if document["practice"]:
            show("how far the practice was off", [off], False)
    if found.failures:
        raise typer.Exit(1)
