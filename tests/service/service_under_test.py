"""A real front on a real socket, with an engine that writes down what it is told."""

import asyncio
import shutil
import subprocess
import threading
import time

import pytest

from haptix.service.front.access import Access, Listen, listens
from haptix.service.front.application import application
from haptix.service.front.assets import AssetStore
from haptix.service.front.connections import HttpServer
from haptix.service.front.hub import Hub
from haptix.service.front.stop_path import StopPath
from haptix.service.protocol.messages import DeviceMessage, Inventory, Problem
from tests.waiting import wait_for


class WrittenEngine:
    """Writes down what it is told, and when."""

    def __init__(self):
        self.told, self.reports = [], []
        self.refuses = {}
        self.arming_s = 0.0

    async def ask(self, do, **fields):
        if do == "arm":
            await asyncio.sleep(self.arming_s)
        self.told.append((do, fields, time.monotonic()))
        if do in self.refuses:
            raise Problem("device", self.refuses[do])
        return {"revision": 1, "effect_id": 1, "reachable_mu": [0.25, 0.5]}

    def tell(self, do, **fields):
        if do != "tick":
            self.told.append((do, fields, time.monotonic()))

    def touch(self, reports):
        self.reports += reports

    def when(self, do):
        """Times at which it was told to do something."""
        return [at_s for name, _, at_s in self.told if name == do]


def certified(folder):
    """Where other machines reach a service, with a certificate for localhost that is made here."""
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl, to make a certificate")
    listen = Listen("localhost", folder / "certificate.pem", folder / "key.pem")
    made = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"]
    made += ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"]
    files = ["-keyout", str(listen.key), "-out", str(listen.certificate)]
    subprocess.run([*made, *files], check=True, capture_output=True)
    return listen


class Service:
    """Serves until it is closed."""

    def __init__(self, folder, documents=None, listen=None):
        self.engine, self.folder = WrittenEngine(), folder
        sockets = [listens("127.0.0.1" if listen is None else listen.host, 0)]
        self.port = sockets[0].getsockname()[1]
        self.access = Access(self.port, folder, (listen.host,) if listen else ())
        device = DeviceMessage(address="usb:serial=SECRET7", name="SECRET7", is_real=True)
        inventory = Inventory(devices=(device,), finger="semi-wet", screen="3m-sct3250", kinds=())
        self.hub = Hub(self.access, self.engine, inventory, "mock:")
        # A busy machine must not change what a test sees; stalls are tested by themselves.
        self.hub.stalls.late_s = lambda now_s: 0.0  # type: ignore[method-assign]
        assets = AssetStore(folder / "assets")
        self.app = application(self.hub, assets, self._start, self._end, documents)
        tls = {"ssl_certfile": listen.certificate, "ssl_keyfile": listen.key} if listen else {}
        self.server = HttpServer(self.app, **tls)
        self.thread = threading.Thread(target=self.server.run, args=(sockets,))
        self.thread.start()
        wait_for(lambda: self.server.started)

    async def _start(self):
        self.stop_path = StopPath(self.hub.stop)
        self.access.write_entry(self.stop_path.port)

    async def _end(self):
        await asyncio.to_thread(self.stop_path.close)

    def close(self):
        self.server.config.timeout_graceful_shutdown = 0  # the tests are over: nobody is waited for
        self.server.should_exit = True
        self.thread.join()


async def is_reached(normal_force_n):
    """Return a friction that a screen may give: that of semi-wet on 3m-sct3250 at 0.5 N."""
    return 0.2648, 0.3482
