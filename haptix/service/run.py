"""Put the service together: hub, engine, HTTP server."""

from __future__ import annotations

import socket
import ssl
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import uvicorn

from haptix.errors import DeviceError, InputError
from haptix.service import messages as m
from haptix.service.access import Access, service_folder
from haptix.service.assets import AssetStore
from haptix.service.front import application
from haptix.service.hub import Hub
from haptix.service.link import EngineProcess
from haptix.service.messages import Problem

DEFAULT_PORT = 7421


class Listen(NamedTuple):
    """Where other machines reach the service, always by TLS.

    Parameters
    ----------
    host : str
        Name or address of this machine that clients use.
    certificate, key : Path
        Certificate of that name and its key, in PEM.
    """

    host: str
    certificate: Path
    key: Path


class _Server(uvicorn.Server):
    """Goes to 0 V before it lets its clients go."""

    hub: Hub

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self.hub.stop("the service ends")
        super().handle_exit(sig, frame)


def serve(
    device: str = "mock:pace=real",
    surface: Path | None = None,
    finger: str | None = None,
    screen: str | None = None,
    port: int = DEFAULT_PORT,
    folder: Path | None = None,
    listen: Listen | None = None,
    on_ready: Callable[[Access, m.Inventory], None] = lambda access, inventory: None,
) -> None:
    """Serve clients of this machine until interrupted.

    Parameters
    ----------
    device : str
        Address of the driver, see `firmware_io.open_device`.
    surface : Path, optional
        Surface of `haptix build`. By default one is loaded or built for the finger and screen.
    finger, screen : str, optional
        Presets or files. By default the profile installed for the device, or presets.
    port : int
        TCP port on 127.0.0.1; 0 for any free one.
    folder : Path, optional
        Where tokens are kept, see `service_folder`.
    listen : Listen, optional
        Where other machines reach the service; by default none does.
    on_ready : callable
        Called once clients can come, with the keeper of the codes and what there is.

    Raises
    ------
    DeviceError
        If the port is taken, or the device or surface cannot be opened.
    InputError
        If certificate and key cannot be used.
    """
    if listen is not None:
        _check(listen)
    listener = listens(listen.host if listen else "127.0.0.1", port)
    number = listener.getsockname()[1]
    folder = folder or service_folder()
    access = Access(number, folder, (listen.host,) if listen else ())
    assets = AssetStore(folder / "assets")
    empty = m.Inventory(devices=(), finger="", screen="", kinds=())
    opening = {
        "device": device,
        "surface": str(surface) if surface else None,
        "finger": finger,
        "screen": screen,
        "assets": str(assets.folder),
    }
    failure: list[Problem] = []
    link = EngineProcess(
        opening, lambda event: hub.hear_engine(event), lambda name, data: hub.hear_frame(name, data)
    )
    hub = Hub(access, link, empty, device)

    async def start() -> None:
        try:
            found = await link.start()
        except Problem as problem:
            failure.append(problem)
            server.should_exit = True
            return
        hub.inventory, hub.material_schema = _inventory(device, found), found["schema"]
        hub.profiles = found["profiles"]
        on_ready(access, hub.inventory)

    config = uvicorn.Config(
        application(hub, assets, start, link.stop),
        log_level="warning",
        ws="websockets-sansio",
        ws_max_size=m.MOST_TEXT_BYTES,
        ws_per_message_deflate=False,  # work for bytes that leave no machine
        ws_ping_interval=None,  # the session's own pings show that the script lives
        timeout_graceful_shutdown=2,
        server_header=False,
        ssl_certfile=listen.certificate if listen else None,
        ssl_keyfile=listen.key if listen else None,
    )
    server = _Server(config)
    server.hub = hub
    try:
        server.run(sockets=[listener])
    finally:
        access.close()
        listener.close()
    if failure:
        raise DeviceError(failure[0].sentence)


def listens(host: str, port: int) -> socket.socket:
    """Return a socket whose connections send at once.

    Raises
    ------
    DeviceError
        If the port is taken.
    """
    try:
        listener = socket.create_server((host, port))
    except OSError as error:
        raise DeviceError(
            f"cannot listen on {host}, port {port}: {error.strerror or error}; give a name of this "
            "machine and a --port that no other service has"
        ) from None
    # asyncio does so only for sockets that it made itself. Otherwise a ping or an event waits until
    # the client's system acknowledges the one before, 40 ms later (Nagle's algorithm, RFC 896).
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def _check(listen: Listen) -> None:
    """Refuse a certificate that TLS cannot use, before a device is opened."""
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(listen.certificate, listen.key)
    except OSError as error:  # an SSLError is one
        raise InputError(
            f"expected a certificate and its key in PEM, got {listen.certificate} and "
            f"{listen.key}: {error}"
        ) from None


def _inventory(device: str, found: dict[str, Any]) -> m.Inventory:
    return m.Inventory(
        devices=(
            m.DeviceMessage(
                address=device, name=found["device"], is_real=not device.startswith("mock:")
            ),
        ),
        finger=found["finger"],
        screen=found["screen"],
        kinds=tuple(found["kinds"]),
    )
