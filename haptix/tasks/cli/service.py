"""``haptix serve`` and ``haptix studio``.

They are written by hand: they run until a person ends them, and have no result.
"""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from haptix.base.errors import InputError
from haptix.base.fields import Address, FileThere, NewFile, Text
from haptix.model.presets import FingerName, ScreenName
from haptix.tasks.cli.application import option
from haptix.tasks.login import running_service

if TYPE_CHECKING:
    from haptix.service.front.access import Access
    from haptix.service.protocol.messages import Inventory

Device = Annotated[str, option("The driver, see `haptix devices`.", Address)]
Surface = Annotated[
    Path | None, option("Surface of `haptix build`. [default: built and kept]", FileThere)
]
LogFile = Annotated[
    Path | None,
    option("Log to this file, see docs/log.md; all frames, but for `haptix --log info`.", NewFile),
]
_FINGER = "Finger. [default: finger.toml beside a calibrated screen, or semi-wet]"
_SCREEN = "Screen. [default: the device's installed profile, or 3m-sct3250]"
TouchedBy = Annotated[
    str | None,
    option("Finger that truly touches a mock, to see sensing. [default: the finger]", FingerName),
]
OwnFinger = Annotated[str | None, option(_FINGER, FingerName)]
OwnScreen = Annotated[str | None, option(_SCREEN, ScreenName)]
Port = Annotated[int, typer.Option(help="TCP port on this machine.", min=0, max=65535)]


def serve(
    device: Device = "mock:pace=real",
    surface: Surface = None,
    finger: OwnFinger = None,
    screen: OwnScreen = None,
    port: Port = 7421,
    listen: Annotated[
        str | None, option("Name by which other machines reach this one; needs TLS.", Text)
    ] = None,
    certificate: Annotated[Path | None, option("Its certificate, PEM.", FileThere)] = None,
    key: Annotated[Path | None, option("The certificate's key, PEM.", FileThere)] = None,
    touched_by: TouchedBy = None,
    log: LogFile = None,
) -> None:
    """Serve apps in any language on this machine: touches and materials in, friction out.

    Without arguments it plays to a mock device, so no hardware is needed. A page is let in by the
    code that is printed here; programs of this user read service.json.
    """
    if (listen is None) != (certificate is None) or (listen is None) != (key is None):
        if listen is None:
            raise InputError("--certificate and --key are for --listen")
        raise InputError("--listen: expected --certificate and --key too; others come by TLS")

    def ready(access: Access, inventory: Inventory) -> None:
        address = max(access.origins) if listen else min(access.origins)
        _say(f"haptix serves {inventory.devices[0].name} at {address} with {_used(inventory)}")
        _say_code(access.code())
        access.on_show = _say_code

    beyond = (listen, certificate, key) if listen and certificate and key else None
    _serve(
        log, beyond, device=device, surface=surface, finger=finger, screen=screen, port=port,
        on_ready=ready, touched_by=touched_by,
    )  # fmt: skip


def studio(
    device: Device = "mock:pace=real",
    surface: Surface = None,
    finger: OwnFinger = None,
    screen: OwnScreen = None,
    port: Port = 7421,
    opens: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in this machine's browser.")
    ] = True,
    touched_by: TouchedBy = None,
    log: LogFile = None,
) -> None:
    """Open the studio in a browser: feel textures by mouse, pen or touch, make and test them.

    It is the service of `haptix serve` with its own pages. Without arguments it plays to a mock
    device: what a finger would feel is computed, drawn and made audible. Where a service of this
    user runs, it opens the pages of that.
    """
    own = (device, surface, finger, screen, touched_by, log)
    if own == ("mock:pace=real", *(None,) * 5) and (running := running_service()):
        _say(f"opens that of the service that runs: http://127.0.0.1:{running[0]}/")
        if opens and _has_browser():
            webbrowser.open("http://127.0.0.1:{}/#code={}".format(*running))
        return

    def ready(access: Access, inventory: Inventory) -> None:
        address = f"{min(access.origins)}/#code={access.code()}"
        _say(f"the studio is at {address} (five minutes, once) with {_used(inventory)}")
        _say(f"driver {inventory.devices[0].name}; Ctrl+C ends it")
        access.on_show = _say_code
        if opens and _has_browser():
            page = access.write_entrance(address)
            # Some browsers answer only when they end.
            threading.Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()

    _serve(
        log, None, device=device, surface=surface, finger=finger, screen=screen, port=port,
        on_ready=ready, touched_by=touched_by, feels=True,
    )  # fmt: skip


def _serve(log: Path | None, beyond: tuple[str, Path, Path] | None, **how: Any) -> None:
    from haptix.base.log import into
    from haptix.service.front.access import Listen
    from haptix.service.front.startup import serve as serve_until_interrupted

    if log is not None:
        into(log)
    serve_until_interrupted(listen=Listen(*beyond) if beyond else None, **how)


def _has_browser() -> bool:
    """Whether a page would be seen: not by a browser within this terminal, nor without a screen."""
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or os.environ.get("BROWSER")
    ):
        return False
    try:
        webbrowser.get()
    except webbrowser.Error:
        return False
    return True


def _used(inventory: Inventory) -> str:
    return f"finger {inventory.finger}, screen {inventory.screen}"


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def _say_code(code: str) -> None:
    _say(f"code for a page: {code} (five minutes, once)")
