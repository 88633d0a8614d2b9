"""Slides over ribs: python touching.py COUNT INTERVAL_S [asyncio], or python touching.py ten.

One finger by the client, printing when each batch was sent. Or ten, in batches 1,000 times a second
until interrupted, by as few instructions as can be: the load is to be on the service.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import struct
import sys
import threading
import time
from contextlib import suppress
from math import sin
from pathlib import Path
from typing import Any

from websockets.sync.client import connect
from websockets.typing import Subprotocol

import haptix.service.client.connection

MATERIAL = {"kind": "grating", "period_mm": 2.0, "low": 0.6, "high": 0.9}
REGION = {"name": "ribs", "x_mm": 0, "y_mm": 0, "width_mm": 100, "height_mm": 60}
LAYOUT = {"regions": [REGION | {"material": MATERIAL}]}


def plain(count: int, interval_s: float) -> list[float]:
    sent_s = []
    with haptix.service.client.connection.connect("Python") as h:
        h.layout_set(LAYOUT)
        h.acquire()
        h.arm()
        time.sleep(1.0)
        for number in range(count):
            sent_s.append(time.monotonic())
            h.touch(50 + 30 * sin(number / 50), 30, 0.5)
            time.sleep(interval_s * (0.5 + random.random()))
        time.sleep(0.3)
    return sent_s


async def concurrent(count: int, interval_s: float) -> list[float]:
    sent_s = []
    async with await haptix.service.client.connection.connect_async("asyncio") as h:
        await h.layout_set(LAYOUT)
        await h.acquire()
        await h.arm()
        await asyncio.sleep(1.0)
        for number in range(count):
            sent_s.append(time.monotonic())
            await h.touch(50 + 30 * sin(number / 50), 30, 0.5)
            await asyncio.sleep(interval_s * (0.5 + random.random()))
        await asyncio.sleep(0.3)
    return sent_s


def ten() -> None:
    found = json.loads((Path(os.environ["HAPTIX_SERVICE"]) / "service.json").read_text())
    socket = connect(
        f"ws://127.0.0.1:{found['port']}/v1/session",
        subprotocols=[Subprotocol("haptix.v1")],
        proxy=None,
    )
    armed = threading.Event()

    def hears() -> None:
        for text in socket:
            message: Any = json.loads(text)
            if message["type"] == "ping":
                pong = {"type": "pong", "n": message["n"], "clock_s": time.monotonic()}
                socket.send(json.dumps(pong))
            elif message["type"] == "error":
                sys.stderr.write(f"{text!r}\n")
            elif message["type"] == "output" and message["state"] == "armed":
                armed.set()

    threading.Thread(target=hears, daemon=True).start()
    hello = {"protocol": "1.0", "client": "ten fingers", "token": found["token"]}
    asked = [("hello", hello), ("layout_set", {"document": LAYOUT}), ("acquire", {}), ("arm", {})]
    for number, (kind, fields) in enumerate(asked, 1):
        socket.send(json.dumps({"type": kind, "id": number, **fields}))
    armed.wait(10)
    began_s, sent = time.monotonic(), 0
    while True:
        t_s = time.monotonic()
        x_mm = 50 + 30 * sin(4 * t_s)
        records = (
            struct.pack("<iBBHffff", 0, finger, 1 | 8, 0, x_mm, 5.0 + 5 * finger, 0.5, 0.0)
            for finger in range(10)
        )
        socket.send(struct.pack("<BBHId", 1, 1, 10, sent, t_s) + b"".join(records))
        sent += 1
        time.sleep(max(0.0, began_s + sent / 1000 - time.monotonic()))


if __name__ == "__main__":
    if "ten" in sys.argv:
        with suppress(KeyboardInterrupt):
            ten()
        sys.exit()
    how = int(sys.argv[1]), float(sys.argv[2])
    print(json.dumps(asyncio.run(concurrent(*how)) if "asyncio" in sys.argv else plain(*how)))
