"""Runs a golden session by hand against a service: the model for the runners of other languages."""

import json
import struct
import time
from pathlib import Path

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from haptix.service.protocol.batches import write_touches
from haptix.service.protocol.messages import TouchMessage
from haptix.service.protocol.messages.reading import read_server
from tests.waiting import PATIENCE_S

GOLDEN = Path(__file__).parents[2] / "clients" / "golden"
SESSIONS = sorted(path.stem for path in GOLDEN.glob("*.jsonl") if path.stem != "bytes")


def lines(name):
    return [json.loads(line) for line in (GOLDEN / f"{name}.jsonl").read_text().splitlines()]


def written(line):
    """Bytes of the touches beside a line's hex."""
    touches = [dict(each) for each in line["touches"]]
    coalesced = [each.pop("coalesced", False) for each in touches]
    return bytearray(
        write_touches([TouchMessage(**each) for each in touches], line["number"])
    ), coalesced


class Run:
    """One session over a socket of its own; the client's clock is the time since its begin."""

    def __init__(self, port, token):
        self.began_s, self.token = time.monotonic(), token
        self.same = {}
        url = f"ws://127.0.0.1:{port}/v1/session"
        self.socket = connect(url, subprotocols=[Subprotocol("haptix.v1")], proxy=None)

    def now_s(self):
        return time.monotonic() - self.began_s

    def play(self, name):
        with self.socket:
            for line in lines(name):
                if line["from"] == "server":
                    self.expect(line)
                    continue
                # The format's "not before": a floor, after which any machine may take its time.
                time.sleep(max(line["at_s"] - self.now_s(), 0))
                self.socket.send(self.filled(line))

    def filled(self, line):
        """What the client sends."""
        if "text" in line:
            text = line["text"]
            text = text if isinstance(text, str) else json.dumps(text)
            return text.replace('"$now"', repr(self.now_s())).replace("$token", self.token)
        data = bytearray.fromhex(line["hex"])
        if "touches" in line:
            assert written(line)[0] == data
            struct.pack_into("<d", data, 8, self.now_s())
        return bytes(data)

    def expect(self, line):
        while True:
            try:
                data = self.socket.recv(timeout=PATIENCE_S)
            except ConnectionClosed as closed:
                assert closed.rcvd and closed.rcvd.code == line.get("close")
                return
            if isinstance(data, bytes):
                continue
            message = json.loads(data)
            read_server(data)  # its type knows every field
            if self.fits(line.get("text"), message):
                return
            if message["type"] == "ping":
                pong = {"type": "pong", "n": message["n"], "clock_s": self.now_s()}
                self.socket.send(json.dumps(pong))
            else:  # events come when they come; answers and errors do not
                assert message["id"] == 0 and message["type"] != "error", (line, message)

    def fits(self, expected, got):
        if isinstance(expected, str) and expected.startswith("$same:"):
            return self.same.setdefault(expected, got) == got
        if isinstance(expected, dict) and isinstance(got, dict):
            keys = expected.keys() == got.keys()
            return keys and all(self.fits(expected[key], got[key]) for key in expected)
        return expected in ("$any", got)
