"""Files and documents that are small and become large: refused, by code, path and id.

Nothing here unpacks in the engine: its limits are read from headers and sizes. What unpacks in a
process of its own ends there with its memory and its time (`test_documents`, `test_jobs`).
"""

import asyncio
import gzip
import io
import json
import struct
import zlib
from http.client import HTTPConnection
from typing import Any

import numpy as np
import pytest
import soundfile

from haptix.feel.materials import decoded
from haptix.service.front.application import MOST_BODY_BYTES
from haptix.service.front.assets import AssetStore, Decoding
from haptix.service.protocol.messages import Problem
from haptix.service.worker.document_work import DocumentWork
from tests.service.service_under_test import Service
from tests.service.test_decoding import OPENING, bomb, kept
from tests.service.test_sessions import Client
from tests.waiting import PATIENCE_S


class PoolHere:
    """The workers' answers, in this process."""

    def __init__(self, work):
        self.work = work

    async def ask(self, owner, do, **fields):
        try:
            return getattr(self.work, do)(**fields)
        except Exception as error:
            raise Problem("document", str(error)) from None


class MakingService(Service):
    """A service that decodes what a document names, in this process."""

    store: AssetStore


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    service = MakingService(tmp_path_factory.mktemp("service"))
    store = service.store = AssetStore(service.folder / "assets")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(decoded, "_place", None)
        decoded.keep_in(service.folder / "decoded", makes=True)
        pool = PoolHere(DocumentWork(store.folder, OPENING))
        service.hub.decode = Decoding(store, pool)
        yield service
    service.close()


def flac(samples, claimed=None):
    """Silence; its header may claim another length: 0 for unknown."""
    made = io.BytesIO()
    soundfile.write(made, np.zeros(samples), 48_000, format="FLAC", subtype="PCM_16")
    content = bytearray(made.getvalue())
    if claimed is not None:  # 36 bits, 18 bytes after the name of the format and the block's head
        content[21] = content[21] & 0xF0 | claimed >> 32
        content[22:26] = struct.pack(">I", claimed & 0xFFFFFFFF)
    return bytes(content)


def tiff(pages):
    """Pages of one pixel in a row; the last one leads back to the first."""
    tags = [
        (256, 1),
        (257, 1),
        (258, 8),
        (259, 1),
        (262, 1),
        (273, 8),
        (277, 1),
        (278, 1),
        (279, 1),
    ]
    size = 2 + 12 * len(tags) + 4
    out = b"II*\0" + struct.pack("<I", 8)
    for page in range(pages):
        after = 8 + size * ((page + 1) % pages)
        out += struct.pack("<H", len(tags))
        out += b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
        out += struct.pack("<I", after)
    return out


def chunks(kind, data):
    """A PNG of one pixel with a chunk that unpacks to much."""
    png = bomb(1)
    body = kind + data
    chunk = struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))
    return png[:33] + chunk + png[33:]


MUCH = zlib.compress(bytes(20_000_000), 9)
SOUND = {"kind": "transient", "curve": {"kind": "recorded"}}
BOMBS: dict[str, tuple[bytes, str, dict[str, Any]]] = {
    "png of gigabytes": (bomb(60_000), ".png", {"kind": "photograph", "width_mm": 9.0}),
    "png of text": (chunks(b"zTXt", b"a\0\0" + MUCH), ".png", {"kind": "heights", "width_mm": 9.0}),
    "png of colours": (chunks(b"iCCP", b"a\0\0" + MUCH), ".png", {"kind": "photograph"}),
    "gif of gigabytes": (b"GIF89a" + b"\xff" * 4 + b"\0" * 20, ".png", {"kind": "photograph"}),
    "tiff in a ring": (tiff(300), ".tif", {"kind": "photograph", "width_mm": 9.0}),
    "svg": (b"<svg>" + b"<g>" * 100_000, ".png", {"kind": "photograph", "width_mm": 9.0}),
    "flac of minutes": (flac(3_000_000), ".flac", SOUND),
    "flac that claims hours": (flac(100, 2**36 - 1), ".flac", SOUND),
    "flac that never ends": (flac(100, 0), ".flac", SOUND),
    "flac in a table's clothes": (flac(3_000_000), ".csv", SOUND),
    "table of rows": (b"position_mm,mu\n" + b"1,1\n" * 600_000, ".csv", {"kind": "recording"}),
    "table of columns": (b"position_mm,mu" + b",a" * 1_100_000, ".csv", {"kind": "recording"}),
    "xml of elements": (b"<a>" + b"<b/>" * 600_000, ".xml", {"kind": "penn"}),
    "gzip": (gzip.compress(bytes(10_000_000)), ".png", {"kind": "photograph", "width_mm": 9.0}),
}


def holds(service):
    """Another app that is felt meanwhile."""
    client = Client(service)
    client.ask("acquire", takeover=True)
    assert client.ask("arm")["state"] == "armed"
    return client


def layout(material, name="bomb"):
    region = {"name": name, "x_mm": 0, "y_mm": 0, "width_mm": 9, "height_mm": 9}
    return {"regions": [{**region, "material": material}]}


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_in_a_file_is_refused_and_nobody_else_notices(service, name):
    content, suffix, material = BOMBS[name]
    assert len(content) < 3_000_000
    digest = f"sha256:{kept(service.store, content, suffix)}"
    where = "/document/regions/0/material" + ("/curve" if "curve" in material else "")
    if "curve" in material:
        material = {**material, "curve": {**material["curve"], "file": digest}}
    else:
        material = {**material, "file": digest}
    with holds(service) as holder, Client(service) as client:
        service.engine.told.clear()
        refused = client.ask("layout_set", document=layout(material))
        assert (refused["type"], refused["path"]) == ("error", where + "/file"), refused
        assert refused["code"] in ("document", "limit") and len(refused["sentence"]) > 20
        assert client.ask("inventory")["type"] == "inventory"
        assert "curve" not in material or holder.ask("play", effect=material)["type"] == "error"
        assert service.hub.control.output.state != "off"
        # The engine hears of none of it. The holder reads nothing meanwhile, and may fall asleep.
        assert {do for do, *_ in service.engine.told} <= {"sleep", "wake"}


def test_a_short_sound_passes(service):
    digest = kept(service.store, flac(100), ".flac")
    curve = {"kind": "recorded", "file": f"sha256:{digest}"}
    with Client(service) as client:
        answer = client.ask("layout_set", document=layout({"kind": "transient", "curve": curve}))
        assert answer["type"] == "layout"


def test_a_layout_that_takes_long_stops_nobody(service, monkeypatch):
    monkeypatch.setattr("haptix.service.front.session_socket.LAYOUT_WAIT_S", 0.05)

    async def takes_long(do, **fields):
        await asyncio.sleep(60.0 if do == "layout_set" else 0.0)
        return {}

    with holds(service), Client(service) as client:
        monkeypatch.setattr(service.engine, "ask", takes_long)
        service.engine.told.clear()
        refused = client.ask("layout_set", document={"regions": []})
        assert (refused["code"], refused["id"]) == ("limit", client.number)
        assert not service.engine.when("stop")
        assert service.hub.control.output.state != "off"


def post(service, route, body, **headers):
    connection = HTTPConnection("127.0.0.1", service.port, timeout=PATIENCE_S)
    headers |= {"Authorization": f"Bearer {service.access.native}"}
    connection.request("POST", route, body, headers | {"Content-Type": "application/json"})
    answer = connection.getresponse()
    return answer.status, json.loads(answer.read())


@pytest.mark.parametrize(
    ("body", "refusal"),
    [
        (b"[" * 500_000, (413, "limit")),
        (b'{"a":' * 100_000, (413, "limit")),
        (b'{"material": ' + b"9" * 10**6, (422, "message")),
    ],
)
def test_rest_refuses_a_body_that_never_ends(service, body, refusal):
    status, found = post(service, "/v1/headroom", body)
    assert (status, found["code"]) == refusal and found["sentence"]


@pytest.mark.parametrize("says", [True, False])
def test_rest_reads_no_more_than_a_body_may_have(service, says):
    body = b" " * (MOST_BODY_BYTES + 1)
    chunks = iter([body[:1000], body[1000:]])  # without a length
    status, found = post(service, "/v1/headroom", body if says else chunks)
    assert (status, found["code"]) == (413, "limit")


def test_a_route_that_is_not_there_is_answered_as_all_else(service):
    status, found = post(service, "/v1/nothing", b"{}")
    assert (status, found["code"], found["id"]) == (404, "unknown", 0)
