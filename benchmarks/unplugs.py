"""A driver that is unplugged and comes back under a sliding finger, many times; see --help.

    python benchmarks/unplugs.py tcp --times 50
    python benchmarks/unplugs.py serial --times 50
    python benchmarks/unplugs.py audio --times 50

Each starts `haptix serve` in processes of its own. The driver of `tcp` and `serial` is the
firmware's core at real pace, behind a socket or a pseudo-terminal; the time to 0 V is by its own
record. That of `audio` is JACK's server (jackd with its dummy driver), which is killed. A virtual
driver is armed again by the service; for audio, whose driver is real, a person's button is
`arm`, once a time. Nothing is started again. "Felt again" counts from the moment at which the
driver is back to the first volts; for audio, from the button to the first friction that the
service reports as rendered under the finger. JACK's server is back when it takes clients, some
0.4 s after it was started.
"""

from __future__ import annotations

import argparse
import json
import os
import pty
import re
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

import haptix.service.client.connection
from firmware_io import MockDriver
from firmware_io.serve import DriverServer
from haptix.base.errors import DeviceError

GRATING = {"kind": "grating", "period_mm": 2.0, "low": 0.6, "high": 0.9}
PLACE = {"x_mm": 0.0, "y_mm": 0.0, "width_mm": 100.0, "height_mm": 60.0}
LAYOUT = {"regions": [{"name": "ribs", "material": GRATING, **PLACE}]}
RATE_HZ, PATIENCE_S, LOOK_S = 48_000, 60.0, 0.002
GONE_S = 0.3  # between the loss of a driver and its return: a person's hand is slower


def wait_for(is_true: Callable[[], Any]) -> float:
    """Wait until something is true, and return the time [s] that it took."""
    began_s = time.monotonic()
    while not is_true():
        if time.monotonic() > began_s + PATIENCE_S:
            raise TimeoutError("what was waited for did not come true")
        time.sleep(LOOK_S)
    return time.monotonic() - began_s


class Recorded:
    """A driver whose record says when there was voltage."""

    driver: MockDriver

    def is_live(self) -> bool:
        """Whether there was voltage in the last 50 ms."""
        return bool(np.any(self.driver.output_v[-RATE_HZ // 20 :]))

    def to_zero_s(self, cut_s: float) -> float:
        """Time from `cut_s` to the last volt, once all is at rest."""
        wait_for(lambda: not np.any(self.driver.output_v[-RATE_HZ // 2 :]))
        volts, now_s = self.driver.output_v, time.monotonic()
        silent_s = (len(volts) - 1 - np.flatnonzero(volts)[-1]) / RATE_HZ
        return float(now_s - silent_s - cut_s)


class Tcp(Recorded):
    """A mock driver over TCP."""

    is_real = False

    def __init__(self, folder: Path) -> None:
        self.port = 0
        self.plug()
        self.address = self.server.address

    def plug(self) -> None:
        """Begin to serve a driver."""
        self.driver = MockDriver(pace="real", kept_s=60.0)
        self.server = DriverServer(self.driver, port=self.port)
        self.port = self.server.port
        threading.Thread(target=self.server.serve, daemon=True).start()

    def unplug(self) -> None:
        """Close the connection."""
        self.server.stop()


class Serial(Recorded):
    """A mock driver behind a pseudo-terminal, whose name stays as that of udev's links does."""

    is_real = False

    def __init__(self, folder: Path) -> None:
        self.port = folder / "board"
        self.plug()
        self.address = f"serial:port={self.port}"

    def plug(self) -> None:
        """Make a port, and poll a driver behind it as its main loop does."""
        self.driver = MockDriver(pace="real", kept_s=60.0)
        self.controller, port = pty.openpty()
        tty.setraw(port)
        self.port.unlink(missing_ok=True)
        self.port.symlink_to(os.ttyname(port))
        os.close(port)
        self.ends = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self) -> None:
        """Pass bytes between the port and the driver."""
        poll = select.poll()
        poll.register(self.controller, select.POLLIN)
        while not self.ends.is_set():
            flags = dict(poll.poll(1)).get(self.controller, 0)
            if flags & select.POLLHUP:  # nobody has the port open
                time.sleep(LOOK_S)
            data = os.read(self.controller, 4096) if flags & select.POLLIN else b""
            self.driver.receive(data)
            if answer := self.driver.transmit():
                os.write(self.controller, answer)

    def unplug(self) -> None:
        """Pull the cable: the port is gone; the driver goes on until its watchdog ends it."""
        self.ends.set()
        self.thread.join()
        os.close(self.controller)
        self.port.unlink()
        driver = self.driver

        def goes_on() -> None:
            end_s = time.monotonic() + 2.0
            while time.monotonic() < end_s:
                driver.receive(b"")
                driver.transmit()
                time.sleep(LOOK_S)

        threading.Thread(target=goes_on, daemon=True).start()


class Audio:
    """JACK's server with its dummy driver."""

    is_real = True

    def __init__(self, folder: Path) -> None:
        if shutil.which("jackd") is None:
            raise SystemExit("jackd is missing (apt install jackd2)")
        self.name = f"haptixunplugs{os.getpid()}"
        os.environ["JACK_DEFAULT_SERVER"] = self.name
        os.environ["JACK_NO_AUDIO_RESERVATION"] = "1"
        self.plug()
        self.address = "audio:device=system,host_api=jack,full_scale_v=200"

    def plug(self) -> None:
        """Start the server, and wait until it takes clients."""
        quiet = subprocess.DEVNULL
        command = ["jackd", "--no-realtime", "-S", "-n", self.name, "-d", "dummy"]
        command += ["-r", str(RATE_HZ), "-p", "256", "-C", "0", "-P", "2"]
        self.server = subprocess.Popen(command, stdout=quiet, stderr=quiet)
        asks = ["jack_lsp", "-s", self.name]
        wait_for(lambda: subprocess.run(asks, stdout=quiet, stderr=quiet).returncode == 0)

    def unplug(self) -> None:
        """Kill the server."""
        self.server.kill()
        self.server.wait()


LINKS: dict[str, Any] = {"tcp": Tcp, "serial": Serial, "audio": Audio}


class Service:
    """`haptix serve` in processes of its own."""

    def __init__(self, folder: Path, device: str) -> None:
        os.environ["HAPTIX_SERVICE"] = str(folder / "service")
        command = [sys.executable, "-m", "haptix.tasks.cli", "serve", "--port", "0"]
        self.process = subprocess.Popen(
            [*command, "--device", device], stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not re.search(r"http://", line):
            raise SystemExit(f"haptix serve did not start: {line}")

    def sizes(self) -> dict[str, int]:
        """Processes of the service with their threads, open files and memory [MB]."""
        pid = self.process.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        of = [Path(f"/proc/{one}") for one in (pid, *children)]
        pages = [int((one / "statm").read_text().split()[1]) for one in of]
        page_bytes = os.sysconf("SC_PAGE_SIZE")
        return {
            "processes": len(of),
            "threads": sum(len([*(one / "task").iterdir()]) for one in of),
            "files": sum(len([*(one / "fd").iterdir()]) for one in of),
            "megabytes": round(sum(pages) * page_bytes / 1e6),
            "of_the_engine": round(pages[1] * page_bytes / 1e6),
        }

    def end(self) -> None:
        """End it as Ctrl+C does."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(PATIENCE_S)


def run(link: Any, service: Service, times: int) -> dict[str, Any]:
    """Unplug the driver many times, and return figures."""
    states: list[str] = []
    zero_s, told_s, back_s, felt_s = [], [], [], []
    rendered_s: list[float] = []
    sizes: list[dict[str, int]] = []
    engine_mb: list[int] = []
    came_s, starved = 0.0, 0
    ends = threading.Event()

    def slides() -> None:
        while not ends.wait(0.008):
            with suppress(DeviceError):
                client.touch(50 + 30 * float(np.sin(2 * time.monotonic())), 30.0, 0.5)

    def arms() -> bool:
        """Press the button: armed, or not yet."""
        try:
            return bool(client.arm().state == "armed")
        except haptix.service.client.connection.Refused:
            return False

    def feels(frame: Any) -> None:
        if frame.stream == "friction" and np.nan_to_num(frame.rows[:, 7]).max() > 0:
            rendered_s.append(time.monotonic())

    def is_felt() -> bool:
        if states[-1:] == ["failed"]:  # starved: this machine stood still for the watchdog's time
            states.append("starved")
            arms()
        return bool(rendered_s[-1:] > [came_s] if link.is_real else link.is_live())

    with haptix.service.client.connection.connect("unplugged") as client:
        client.on("output", lambda output: states.append(output.state))
        client.layout_set(LAYOUT)
        client.acquire()
        if link.is_real:
            client.on("frame", feels)
            client.ask("subscribe", streams={"friction": 100.0})
        client.arm()
        finger = threading.Thread(target=slides)
        finger.start()
        try:
            wait_for(is_felt)
            for number in range(times):
                time.sleep(0.2)
                states.clear()
                cut_s = time.monotonic()
                link.unplug()
                told_s.append(wait_for(lambda: "failed" in states or "gone" in states))
                if not link.is_real:
                    zero_s.append(link.to_zero_s(cut_s))
                wait_for(lambda: "gone" in states)
                time.sleep(GONE_S)
                link.plug()
                came_s = time.monotonic()
                wait_for(lambda: "back" in states)
                back_s.append(time.monotonic() - came_s)
                if link.is_real:
                    came_s = time.monotonic()
                    wait_for(arms)
                wait_for(is_felt)
                felt_s.append(time.monotonic() - came_s)
                starved += states.count("starved")
                if number in (4, times - 1):  # by then, all that is loaded late is there
                    sizes.append(service.sizes())
                if number % 5 == 4:
                    engine_mb.append(service.sizes()["of_the_engine"])
                if sys.stderr.isatty():
                    sys.stderr.write(f"\r{number + 1} of {times}")
        finally:
            ends.set()
            finger.join()
    figures = {"told_s": told_s, "to_0_v_s": zero_s, "back_s": back_s, "felt_again_s": felt_s}
    return {
        "times": times,
        "starved": starved,
        **{
            name: {"median": round(float(np.median(row)), 3), "longest": round(max(row), 3)}
            for name, row in figures.items()
            if row
        },
        "engine_megabytes_each_five": engine_mb,
        "after_five": sizes[0],
        "at_the_end": sizes[-1],
    }


def main() -> None:
    """Run for one link."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("link", choices=LINKS)
    parser.add_argument("--times", type=int, default=50)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        link = LINKS[options.link](Path(folder))
        service = Service(Path(folder), link.address)
        try:
            figures = run(link, service, options.times)
        finally:
            service.end()
            with suppress(Exception):
                link.unplug()
    sys.stdout.write(json.dumps({"link": options.link, **figures}, indent=2) + "\n")


if __name__ == "__main__":
    main()
