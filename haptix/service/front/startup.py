"""Put the service together: a front, which is this process, one engine, and one pool of workers.

clients <--HTTP, WebSocket--> front <--frames--> engine <--> driver
                               +--touches, amplitudes--> worker: the virtual finger
                               +--frames--> workers, each for one owner: files, pictures, jobs
"""

from __future__ import annotations

import asyncio
import re
import shutil
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from haptix.base.errors import DeviceError, InputError, from_extra
from haptix.base.files import write_failure
from haptix.base.log import without_secrets
from haptix.feel.gallery import ASSETS as GALLERY_ASSETS
from haptix.service.front.access import Access, Listen, check_certificate, listens
from haptix.service.front.assets import AssetStore, Decoding
from haptix.service.front.engine_process import EngineProcess
from haptix.service.front.hub import Hub
from haptix.service.front.pool import Pool
from haptix.service.protocol import messages as m
from haptix.service.protocol.limiter import service_folder
from haptix.service.protocol.messages import Problem, reading

DEFAULT_PORT = 7421


def serve(
    device: str = "mock:pace=real",
    surface: Path | None = None,
    finger: str | None = None,
    screen: str | None = None,
    port: int = DEFAULT_PORT,
    folder: Path | None = None,
    listen: Listen | None = None,
    on_ready: Callable[[Access, m.Inventory], None] = lambda access, inventory: None,
    touched_by: str | None = None,
    feels: bool = False,
) -> None:
    """Serve clients of this machine until interrupted.

    Raises `DeviceError` if the port is taken, or the device or surface cannot be opened;
    `InputError` if certificate and key cannot be used, or the folder is another service's;
    `MissingExtraError` if the extra ``serve`` is not installed.

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
    touched_by : str, optional
        Finger that truly touches a mock device: it feels, and draws the current that is sensed.
        By default the finger.
    feels : bool
        Whether the virtual finger loads at once, and not with the first subscription to `felt`,
        and what draws materials before the first picture is asked for.
    """
    with from_extra("serve"):
        for name in ("fastapi", "uvicorn", "websockets"):  # imported while the engine starts
            if find_spec(name) is None:
                raise ModuleNotFoundError(name=name)
    if listen is not None:
        check_certificate(listen)
    listener = listens(listen.host if listen else "127.0.0.1", port)
    number = listener.getsockname()[1]
    folder = folder or service_folder()
    lock = FileLock(folder / "service.lock", timeout=0)
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        lock.acquire()
        access = Access(number, folder, (listen.host,) if listen else ())
        assets = AssetStore(folder / "assets")
        assets.keep(GALLERY_ASSETS)
    except Timeout:
        raise InputError(
            f"{folder}: expected a folder that no service uses, but one runs with it; end that, or "
            "name another folder in HAPTIX_SERVICE"
        ) from None
    except OSError as error:
        why = write_failure(error, folder)
        raise InputError(f"cannot write to the service's folder {folder}: {why}") from error
    empty = m.Inventory(devices=(), finger="", screen="", kinds=())
    opening = {
        "device": device,
        "surface": str(surface) if surface else None,
        "finger": finger,
        "screen": screen,
        "touched_by": touched_by,
        "assets": str(assets.folder),
    }
    failure: list[Problem] = []
    link = EngineProcess(
        opening, lambda event: hub.on_engine_event(event), lambda data: hub.on_telemetry(data)
    )
    shown = without_secrets(device)  # a link of another package may know a token
    hub = Hub(access, link, empty, shown)

    async def run() -> None:
        starting = asyncio.create_task(link.start())
        if feels:  # the page subscribes once it is there, or it ends after a minute
            link.felt_finger.want(True)
        await asyncio.sleep(0)  # its process starts here, and loads while this one does
        from fastapi import APIRouter

        from haptix.service.front.application import application
        from haptix.service.front.connections import HttpServer
        from haptix.service.front.in_use import drive_router
        from haptix.service.front.rest import documents_router
        from haptix.service.front.stop_path import StopPath

        reading.build()
        # A page that feels also shows pictures.
        pool = Pool({"assets": opening["assets"], "draws": feels}, tell=hub.warn)
        if feels:
            pool.warm()  # it loads while the engine does, and is opened anew for its owner

        async def start() -> None:
            try:
                opened = await starting
            except Problem as problem:
                failure.append(problem)
                server.should_exit = True
                return
            hub.inventory = inventory_of(shown, opened)
            hub.profiles, hub.schema = opened["profiles"], opened["schema"]
            used = {key: opened[key] for key in ("finger", "screen")}
            pool.opening = {**used, "assets": opening["assets"], "draws": feels}
            pool.opening["surface"] = opening["surface"]
            hub.jobs.context = {**used, "device": device, "assets": opening["assets"]}
            hub.jobs.context["highest_v"] = opened["highest_v"]
            hub.jobs.context["logs"] = str(folder / "experiments")
            hub.jobs.context["calibrations"] = str(folder / "calibrations")
            hub.jobs.results = folder / "results"
            shutil.rmtree(hub.jobs.results, ignore_errors=True)  # of jobs that are forgotten
            on_ready(access, hub.inventory)
            pool.warm()

        async def end() -> None:
            await pool.stop()
            await link.stop()

        hub.decode = Decoding(assets, pool)
        routes = APIRouter()
        routes.include_router(documents_router(pool, folder / "layouts", hub.reach))
        routes.include_router(drive_router(hub, pool))
        app = application(hub, assets, start, end, routes)

        def interrupted() -> None:
            hub.stop("the service ends")
            pool.end()

        tls = {"ssl_certfile": listen.certificate, "ssl_keyfile": listen.key} if listen else {}
        server = HttpServer(app, interrupted, **tls)
        stop_path = StopPath(hub.stop)
        access.write_entry(stop_path.port)
        try:
            await server.serve(sockets=[listener])
        finally:
            await asyncio.to_thread(stop_path.close)

    try:
        asyncio.run(run())
    finally:
        access.close()
        lock.release()
        listener.close()
    if failure:
        raise DeviceError(failure[0].sentence)


def inventory_of(device: str, opened: dict[str, Any]) -> m.Inventory:
    """Return the record that clients get of the driver at an address, and of the profiles."""
    return m.Inventory(
        devices=(
            # Where its token lies concerns no client.
            m.DeviceMessage(
                address=re.sub(r",token_file=[^,]*", "", device),
                name=opened["device"],
                is_real=opened["is_real"],
            ),
        ),
        finger=opened["finger"],
        screen=opened["screen"],
        screen_mm=tuple(opened["screen_mm"]),
        kinds=tuple(opened["kinds"]),
    )
