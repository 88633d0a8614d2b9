"""``haptix serve``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from haptix.errors import InputError

if TYPE_CHECKING:
    from haptix.service.access import Access
    from haptix.service.messages import Inventory


def serve(
    device: Annotated[str, typer.Option(help="The driver, see `haptix devices`.")] = (
        "mock:pace=real"
    ),
    surface: Annotated[
        Path | None, typer.Option(help="Surface of `haptix build`. [default: built and kept]")
    ] = None,
    finger: Annotated[
        str | None, typer.Option(help="Finger. [default: the device's profile, or semi-wet]")
    ] = None,
    screen: Annotated[
        str | None, typer.Option(help="Screen. [default: the device's profile, or 3m-sct3250]")
    ] = None,
    port: Annotated[int, typer.Option(help="TCP port on this machine.", min=0, max=65535)] = 7421,
    listen: Annotated[
        str | None, typer.Option(help="Name by which other machines reach this one; needs TLS.")
    ] = None,
    certificate: Annotated[
        Path | None, typer.Option(help="Its certificate, PEM.", exists=True)
    ] = None,
    key: Annotated[
        Path | None, typer.Option(help="The certificate's key, PEM.", exists=True)
    ] = None,
) -> None:
    """Serve apps in any language on this machine: touches and materials in, friction out.

    Without arguments it plays to a mock device, so no hardware is needed. A page is let in by the
    code that is printed here; programs of this user read service.json.
    """
    try:
        from haptix.service.run import Listen
        from haptix.service.run import serve as serve_until_interrupted
    except ModuleNotFoundError as error:
        raise InputError(
            f"haptix serve needs the extra serve ({error.name} is missing): install "
            "haptix-electrovibration[serve]"
        ) from None

    def ready(access: Access, inventory: Inventory) -> None:
        address = max(access.origins) if listen else min(access.origins)
        sys.stdout.write(
            f"haptix serves {inventory.devices[0].name} at {address}\n"
            f"finger {inventory.finger}, screen {inventory.screen}\n"
            f"code for a page: {access.code()} (five minutes, once)\n"
        )
        sys.stdout.flush()

    beyond = None
    if listen is not None:
        if certificate is None or key is None:
            raise InputError("--listen: expected --certificate and --key too; others come by TLS")
        beyond = Listen(listen, certificate, key)
    elif certificate is not None or key is not None:
        raise InputError("--certificate and --key are for --listen")
    serve_until_interrupted(device, surface, finger, screen, port, listen=beyond, on_ready=ready)
