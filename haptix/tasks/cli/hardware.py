"""``haptix devices``, ``haptix firmware`` and ``haptix doctor``.

They are written by hand: no service, job or campaign should look at the buses of a machine, or ask
to write a rule as root.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import re
import sys
import time
from contextlib import suppress
from dataclasses import asdict
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from haptix.base.errors import DeviceError, FileFormatError, InputError, MissingExtraError
from haptix.base.fields import Address, Folder, NewFile, Positive, Text
from haptix.base.files import write_whole
from haptix.base.terminal import AsJson, show
from haptix.base.version import __version__, foreign_package
from haptix.tasks.cli.application import argument, option

if TYPE_CHECKING:
    from firmware_io.link import DeviceInfo


def devices(as_json: AsJson = False) -> None:
    """List what can be opened, and what the buses show; and the touchscreens of this machine."""
    from firmware_io import list_devices

    show("devices", [*map(asdict, list_devices()), *_touchscreens()], as_json)


def firmware(
    board: Annotated[str, argument("The board: pico or pico2.", Literal["pico", "pico2"])],
    out: Annotated[
        Path | None, option("Where to write it: haptix-BOARD.uf2 if not given.", NewFile)
    ] = None,
    serial: Annotated[str, option("The board's serial number, 1 to 15 characters.", Text)] = "0",
    full_scale_v: Annotated[
        float, option("Voltage of the amplifier at code 32767 [V], 10 to 1000.", Positive)
    ] = 200.0,
    as_json: AsJson = False,
) -> None:
    """Write the firmware of a board, as a file that its USB drive takes."""
    from firmware_io.pico_image import pico_uf2

    if board not in ("pico", "pico2"):
        raise DeviceError(
            f"board must be pico or pico2, but is {board!r}; others are built by their Makefile."
        )
    image = pico_uf2(board, serial, full_scale_v)
    out = out or Path(f"haptix-{board}.uf2")
    if not out.parent.is_dir():
        raise InputError(f"--out: expected a folder that exists, such as the board's drive: {out}")
    write_whole(out, image)
    sha256 = hashlib.sha256(image).hexdigest()
    show("firmware", [{"file": str(out), "bytes": len(image), "sha256": sha256}], as_json)


def doctor(
    as_json: AsJson = False,
    install_udev: Annotated[
        bool,
        typer.Option(
            "--install-udev",
            help="Write the rule that lets the user at this seat open a driver; asks first.",
        ),
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    root: Annotated[Path, option("Folder below which the rule is written.", Folder)] = Path("/"),
    proof_test: Annotated[
        str | None,
        option("Trip each limit of a driver at 0 V, such as usb:, and keep a record.", Address),
    ] = None,
) -> None:
    """Check this machine: packages, a known solve, drivers, audio, permissions, clocks.

    Exit code 1 if something that every use needs is broken.
    """
    from firmware_io import survey_buses

    if proof_test:
        _prove(proof_test, as_json)
        return
    if install_udev:
        _install_udev(root, yes)
        return
    needed = [
        _row("haptix", True, f"{__version__} on Python {platform.python_version()}"),
        _check_packages(),
        _check_torch(),
        _check_cache(),
        _check_solver(),
        _check_firmware(),
    ]
    reports = survey_buses()
    buses = [_row(report.kind, report.available, report.detail) for report in reports]
    found = [device for report in reports for device in report.devices]
    rows = [*needed, *buses, _check_touchscreens(), _check_drivers(found), _check_outputs(found)]
    rows += [_check_udev(root), _check_permissions(found), _check_clock(), _check_timing()]
    show("doctor", rows, as_json)
    if any(row["ok"] == "no" for row in needed):
        raise typer.Exit(1)


def _touchscreens() -> list[dict[str, Any]]:
    """Return the touchscreens as `haptix devices` lists them; none where there can be none."""
    from haptix.play.touch import find_touchscreens

    rows = []
    with suppress(DeviceError, MissingExtraError):
        for found in find_touchscreens():
            size = (
                "size unknown"
                if found.size_mm is None
                else "{:.4g} x {:.4g} mm".format(*found.size_mm)
            )
            many = "one finger" if found.slots == 1 else f"{found.slots or 'some'} fingers"
            rate = "" if found.most_hz is None else f", up to {found.most_hz:.4g} reports per s"
            note = "; ".join([f"{many}, {size}{rate}", *found.odd])
            usable = not any("you may not read it" in text for text in found.odd)
            about = {"address": found.path, "kind": "touchscreen", "name": found.name}
            rows.append({**about, "usable": usable, "note": note})
    return rows


def _check_touchscreens() -> dict[str, Any]:
    from haptix.play.touch import find_touchscreens

    try:
        found = [*find_touchscreens()]
    except (DeviceError, MissingExtraError) as error:
        return _row("touchscreen", False, str(error))
    if not found:
        return _row("touchscreen", False, "none; touches may come from a page or an app as well")
    odd = [f"{each.path} {each.name}: {text}" for each in found for text in each.odd]
    names = ", ".join(f"{each.path} {each.name}" for each in found)
    return _row("touchscreen", not odd, "; ".join(odd) or names)


def _install_udev(root: Path, yes: bool) -> None:
    from firmware_io.links.usb import RULE_FILE, udev_rule, udev_rule_is_installed
    from haptix.base.files import write_whole

    if udev_rule_is_installed(root):
        typer.echo(f"{root / RULE_FILE} is there already.")
        return
    typer.echo(f"{root / RULE_FILE} will hold:\n\n{udev_rule()}")
    if not yes and not typer.confirm("Write it?"):
        typer.echo("Nothing was written.")
        raise typer.Exit(1)
    path = root / RULE_FILE
    try:
        write_whole(path, udev_rule())
    except FileFormatError as error:
        typer.echo(f"haptix: {error}; run it as root: sudo haptix doctor --install-udev", err=True)
        raise typer.Exit(2) from None
    typer.echo(f"Wrote {path}. Now run `udevadm control --reload` as root, and replug the driver.")


def _prove(address: str, as_json: bool) -> None:
    from firmware_io.opening import read_address
    from firmware_io.proof_test import proof_test
    from haptix.base.files import write_whole

    scheme, values = read_address(address)
    if address.startswith("mock:"):
        # Its watchdog needs time that passes; its core's own tests take a few milliseconds.
        values = {"pace": "real", "tests_itself": True} | values
    link = scheme.open(**values)
    try:
        proofs = proof_test(link)
    finally:
        link.close()
    rows = [_row(proof.what, proof.holds, proof.seen) for proof in proofs]
    show("proof test", rows, as_json)
    now = datetime.now(UTC)
    path = Path(f"proof-test-{now:%Y%m%dT%H%M%SZ}.json")
    record = {"date": now.isoformat(), "driver": address, "haptix": __version__, "proofs": rows}
    write_whole(path, json.dumps(record, indent=1) + "\n")
    typer.echo(f"Wrote {path}.", err=True)
    if not all(proof.holds for proof in proofs):
        raise typer.Exit(1)


def _row(what: str, good: bool, detail: str) -> dict[str, Any]:
    return {"check": what, "ok": "yes" if good else "no", "detail": detail}


def _check_drivers(found: list[DeviceInfo]) -> dict[str, Any]:
    """Say which of the devices on USB, HID and serial ports are drivers."""
    buses = ("usb", "hid", "serial")
    drivers = [device.address for device in found if device.usable and device.kind in buses]
    if drivers:
        return _row("driver", True, ", ".join(drivers))
    ports = [device.address for device in found if device.kind == "serial"]
    detail = "none is connected: plug it in and power it; mock: needs none"
    if ports:
        detail += f"; a board whose USB numbers are not haptix's is named: {', '.join(ports)}"
    return _row("driver", False, detail)


def _check_outputs(found: list[DeviceInfo]) -> dict[str, Any]:
    outputs = [device.name for device in found if device.kind == "audio"]
    if not outputs:
        return _row("audio output", False, "none is connected, or no sound server runs")
    mixers = [name for name in outputs if _MIXER.match(name)]
    detail = ", ".join(outputs)
    if len(mixers) == len(outputs):
        detail += "; these mix, resample and drop samples: let JACK or the interface itself be seen"
    return _row("audio output", len(mixers) < len(outputs), detail)


#: Names of outputs that are no interface, but a sound server's or a converter's way to one.
_MIXER = re.compile(r"(pulse|pipewire|default|sysdefault|dmix|Microsoft Sound Mapper)\b", re.I)


def _check_permissions(found: list[DeviceInfo]) -> dict[str, Any]:
    """Say which files of devices this user may not open, and which command gives the right."""
    if not sys.platform.startswith("linux"):
        return _row("permissions", True, "the system asks by itself where it wants to")
    denied = {}
    for device in found:
        for key, form, remedy in _FILES:
            match = re.fullmatch(key, device.address)
            if match and (device.usable or device.kind == "serial"):
                path = form.format(
                    *(int(part) if part.isdigit() else part for part in match.groups())
                )
                if Path(path).exists() and not os.access(path, os.R_OK | os.W_OK):
                    denied[path] = remedy
    sound = [*map(str, Path("/dev/snd").glob("pcm*p"))]
    denied |= {path: _GROUP.format("audio") for path in sound if not os.access(path, os.W_OK)}
    advice = "; ".join(f"{remedy} for {path}" for path, remedy in denied.items())
    return _row("permissions", not denied, advice or "this user may open the connected devices")


_GROUP = "sudo adduser $USER {}, then log in again,"
_RULE = "sudo haptix doctor --install-udev, then replug it,"
#: Address of a device, its file, and what lets a user open that.
_FILES = (
    (r"usb:bus=(\d+),address=(\d+)", "/dev/bus/usb/{:03d}/{:03d}", _RULE),
    (r"hid:path=(/dev/.*)", "{}", _RULE),
    (r"serial:port=(/dev/.*)", "{}", _GROUP.format("dialout")),
)


def _check_clock() -> dict[str, Any]:
    """Say how fine the computer's clock is, and how long it takes to read it."""
    begin_s, count = time.perf_counter(), 20_000
    seen = [time.monotonic() for _ in range(count)]
    read_us = (time.perf_counter() - begin_s) / count * 1e6
    step_us = min((b - a for a, b in pairwise(seen) if b > a), default=math.inf) * 1e6
    source = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    name = f"{source.read_text().strip()}, " if source.exists() else ""
    good = read_us < _SLOW_US and step_us < _COARSE_US
    detail = f"{name}read in {read_us:.2g} us, in steps of {step_us:.2g} us"
    if not good:
        detail += "; choose a faster one: the TSC, as in the kernel's option clocksource=tsc"
    return _row("clock", good, detail)


_SLOW_US, _COARSE_US = (
    5.0,
    500.0,
)  # HPET and ACPI take microseconds; a tick of 15.6 ms is too coarse


def _check_udev(root: Path) -> dict[str, Any]:
    from firmware_io.links.usb import RULE_FILE, udev_rule_is_installed

    good = udev_rule_is_installed(root)
    missing = (
        " is not there; only root can open USB and HID drivers without it: "
        "sudo haptix doctor --install-udev"
    )
    return _row("udev rule", good, f"{root / RULE_FILE}{'' if good else missing}")


_WORK_MS = 2.0  # of a reaction: rendering, the limits, a local link, a driver's guard
_GOOD_MS = 5.0


def _check_timing() -> dict[str, Any]:
    from firmware_io.clock import measure_wake_ups

    wake_ups = measure_wake_ups()
    late_ms, largest_ms = wake_ups.p99_s * 1e3, wake_ups.largest_s * 1e3
    with_it = "with" if wake_ups.is_real_time else "without"
    detail = (
        f"a thread wakes {late_ms:.2g} ms late (99 %; longest {largest_ms:.2g}) {with_it} "
        f"real-time priority: live rendering reacts in {_WORK_MS + late_ms:.2g} ms"
    )
    good = _WORK_MS + late_ms <= _GOOD_MS
    if not wake_ups.is_real_time:
        detail += "; for less: `USER - rtprio 20` in /etc/security/limits.conf, then log in again"
    elif not good:
        detail += "; give the computer less to do"
    return _row("timing", good, detail)


def _check_packages() -> dict[str, Any]:
    from importlib.metadata import distributions

    names = ("calibration", "firmware_io")
    # By the texts of the records: `packages_distributions` looks for each of all installed files.
    records = {one.name: f"\n{one.read_text('RECORD') or ''}" for one in distributions()}
    wrong = [advice for advice in map(foreign_package, names) if advice]
    for name in names:
        owners = {owner for owner, record in records.items() if f"\n{name}/" in record}
        others = owners - {"haptix-electrovibration"}
        wrong += [f"{name}: {other} installs a package of this name too" for other in others]
    return _row("packages", not wrong, "; ".join(wrong) or f"{', '.join(names)}: haptix's own")


def _check_torch() -> dict[str, Any]:
    import torch

    device = torch.cuda.get_device_name() if torch.cuda.is_available() else "no GPU (none needed)"
    return _row("torch", True, f"{torch.__version__}, {torch.get_num_threads()} threads, {device}")


def _check_cache() -> dict[str, Any]:
    from haptix.base.files import cache_folder

    folder = cache_folder()
    nearest = next(above for above in (folder, *folder.parents) if above.exists())
    good = nearest.is_dir() and os.access(nearest, os.W_OK)
    return _row("cache", good, f"{folder}" if good else f"{folder} cannot be written")


def _check_firmware() -> dict[str, Any]:
    from firmware_io import DeviceError, MockDriver

    try:
        MockDriver()
    except DeviceError as error:
        return _row("firmware", False, str(error))
    return _row("firmware", True, "the compiled core, for the mock, audio and DAQ links")


def _check_solver() -> dict[str, Any]:
    from haptix.model.contact import HalfSpace, MeanField, RoughnessSpectrum

    # Physics page, section 5: H = 0.8, q1/q0 = 1e3, no roll-off, h_rms = q0 = E* = 1, p = 1e-2.
    contact = MeanField(RoughnessSpectrum.self_affine(1, 0.8, 1, 1, 1e3), HalfSpace(0.75, 0.5))
    area, gap = float(contact.area_fraction(1e-2)), float(contact.mean_gap(1e-2))
    good = abs(area / 2.070563e-3 - 1) < 1e-6 and abs(gap / 2.3627 - 1) < 1e-3
    return _row("solver", good, f"A/A0 {area:.6e} (2.070563e-03), mean gap {gap:.4f} (2.3627)")
