"""Pictures: decoded by workers alone, and bombs refused on every way in."""

import asyncio
import hashlib
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

import haptix
from haptix.feel.materials import decoded
from haptix.feel.materials.decoded import FOLDER
from haptix.feel.materials.pictures import read_grey
from haptix.service.engine.session_layout import SessionLayout
from haptix.service.front.assets import AssetStore, Decoding
from haptix.service.protocol.messages import Problem
from haptix.service.worker.document_work import DocumentWork
from haptix.service.worker.process import JobWork

OPENING = {"surface": None, "finger": "semi-wet", "screen": "3m-sct3250"}


def bomb(side):
    """A PNG that says it is so large, of a few bytes."""

    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    head = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    rows = zlib.compress(bytes(10**6), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def kept(store, content, suffix=".png"):
    digest = hashlib.sha256(content).hexdigest()
    (store.folder / f"{digest}{suffix}").write_bytes(content)
    return digest


@pytest.fixture
def store(tmp_path):
    return AssetStore(tmp_path / "assets")


def materials(digest):
    """A bomb in every place that a document has for a picture."""
    name = f"sha256:{digest}"
    photograph = {"kind": "photograph", "file": name, "width_mm": 40.0}
    return [
        photograph,
        {"kind": "heights", "file": name, "width_mm": 40.0},
        {"kind": "relief", "heights": name, "width_mm": 40.0},
        {"kind": "relief", "normals": name, "width_mm": 40.0},
        {"kind": "moving", "of": photograph, "velocity_mm_s": [1.0, 0.0]},
    ]


@pytest.mark.parametrize("side", [20_000, 2**31 - 1])
@pytest.mark.parametrize("number", range(5))
def test_a_bomb_is_refused_by_each_route(store, side, number):
    digest = kept(store, bomb(side))
    material = materials(digest)[number]
    work = DocumentWork(store.folder, OPENING)
    region = {"name": "bomb", "material": material, "x_mm": 0, "y_mm": 0}
    region |= {"width_mm": 40, "height_mm": 40}
    context = {"finger": "semi-wet", "screen": "3m-sct3250", "assets": str(store.folder)}
    jobs = JobWork(context, lambda **_: None, iter(()))
    routes = {
        "decode": lambda: work.decode(digest),
        "pictures": lambda: work.picture(material, 10, 10, 8, 0.0, (0.3, 0.6)),
        "check": lambda: work.check(material, (0.3, 0.6)),
        "export": lambda: work.export(
            document={"kind": "layout", "regions": [region]},
            form="hjif",
            y_mm=5.0,
            reachable_mu=(0.3, 0.6),
        ),
        "layout": lambda: SessionLayout(store.folder).set({"regions": [region]}),
        "jobs": lambda: jobs.headroom(material=material, width_mm=10.0, height_mm=10.0),
    }
    for route, ask in routes.items():
        with pytest.raises(haptix.HaptixError, match=r"pixels|too large|image"):
            ask()
        assert not list(store.folder.parent.glob(f"{FOLDER}/*")), route


def test_an_engine_decodes_nothing_and_reads_what_a_worker_kept(store, tmp_path, monkeypatch):
    monkeypatch.setattr(decoded, "_place", None)
    path = tmp_path / "a.png"
    pixels = np.random.default_rng(1).integers(0, 255, (30, 40, 4), dtype=np.uint8)
    Image.fromarray(pixels).save(path)
    digest = kept(store, path.read_bytes())
    file = store.path(digest)
    plain = read_grey(file)
    decoded.keep_in(tmp_path / FOLDER, makes=False)
    with pytest.raises(haptix.InputError, match="not decoded"):
        read_grey(file)
    np.testing.assert_array_equal(read_grey(path), plain)  # its name is no hash: it is its user's
    decoded.keep_in(tmp_path / FOLDER, makes=True)
    read_grey(file)
    decoded.keep_in(tmp_path / FOLDER, makes=False)
    file.write_bytes(b"it is not looked at again")
    np.testing.assert_array_equal(read_grey(file), plain)


class Pool:
    """Notes what it is asked."""

    def __init__(self):
        self.asked = []

    async def ask(self, owner, do, **fields):
        self.asked.append((owner, do, fields["digest"]))
        return {}


def test_each_picture_of_a_message_is_decoded_once(store):
    pool, one = Pool(), kept(store, b"one")
    sound = kept(store, b"sound", ".wav")
    regions = [{"material": {"file": f"sha256:{name}"}} for name in (one, sound, "0" * 64)]
    asyncio.run(Decoding(store, pool)("me", {"document": {"regions": regions}}))
    assert pool.asked == [("me", "decode", one), ("me", "decode", sound)]
    folder = store.folder.parent / FOLDER
    folder.mkdir()
    np.save(folder / f"{one}.npy", np.zeros(1))
    decoding, pool.asked = Decoding(store, pool), []
    for _ in range(2):
        asyncio.run(decoding("me", {"ops": [{"material": {"file": f"sha256:{one}"}}]}))
    assert len(pool.asked) == 1  # its size, once


def test_a_picture_that_cannot_be_is_pointed_to(store):
    class Refusing:
        async def ask(self, owner, do, **fields):
            raise Problem("document", "no picture")

    name = f"sha256:{kept(store, b'one')}"
    ops = [{"op": "remove", "name": "x"}, {"op": "add", "material": {"of": {"file": name}}}]
    with pytest.raises(Problem) as caught:
        asyncio.run(Decoding(store, Refusing())("me", {"ops": ops}))
    assert caught.value.path == "/ops/1/material/of/file"
