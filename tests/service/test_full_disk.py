"""A full disk at each door of the service that writes: 507 and a sentence, and nothing is lost."""

import errno
import hashlib
import tempfile

import httpx
import pytest
from filelock import FileLock

import haptix.base.files
from haptix.base.errors import FileFormatError, InputError
from haptix.feel.materials import decoded
from haptix.service.front.assets import AssetStore
from haptix.service.front.pool import Pool
from haptix.service.front.rest import documents_router
from haptix.service.front.startup import serve
from haptix.service.worker.document_work import DocumentWork
from tests.service.service_under_test import Service, is_reached
from tests.service.test_decoding import OPENING, bomb, kept
from tests.waiting import PATIENCE_S

PAGE = {"Origin": "https://example.org"}
LAYOUT = {"regions": []}
CONTENT = b"a picture"
DIGEST = hashlib.sha256(CONTENT).hexdigest()
MADE_FROM = {"if-match": '"1"'}
MOVES = {("post", "/v1/layouts/{name}/rename")}
"""Doors that need no space."""


@pytest.fixture
def full(monkeypatch):
    """From its call on, nothing can be written."""

    def fails(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    def fills():
        monkeypatch.setattr(haptix.base.files, "_write", fails)
        monkeypatch.setattr(tempfile, "mkstemp", fails)

    return fills


def doors(service, code, token):
    """What to send to each door, by method and path."""
    paired = PAGE | {"Authorization": f"Bearer {token}"}
    return {
        ("put", "/v1/layouts/{name}"): ("/layouts/new", LAYOUT, {}),
        ("delete", "/v1/layouts/{name}"): ("/layouts/desk", None, MADE_FROM),
        ("put", "/v1/drafts/{name}"): ("/drafts/new", {"name": "a", "document": LAYOUT}, {}),
        ("delete", "/v1/drafts/{name}"): ("/drafts/one", None, MADE_FROM),
        ("put", "/v1/person"): ("/person", {"person_intensity": 0.5, "person_muted": False}, {}),
        ("post", "/v1/pair"): ("/pair", {"code": code, "name": "page"}, PAGE),
        ("delete", "/v1/pair"): ("/pair", None, paired),
        ("put", "/v1/assets/{digest}"): (f"/assets/{DIGEST}?suffix=.png", CONTENT, {}),
    }


def test_each_door_that_writes_answers_507(tmp_path, full, capfd):
    service = Service(tmp_path, documents_router(Pool({}), tmp_path / "layouts", is_reached))
    base = f"http://127.0.0.1:{service.port}/v1"
    headers = {"authorization": f"Bearer {service.access.native}"}
    try:
        with httpx.Client(base_url=base, headers=headers, timeout=PATIENCE_S) as rest:
            assert rest.put("/layouts/desk", json=LAYOUT).status_code == 204
            draft = {"name": "desk", "document": LAYOUT}
            assert rest.put("/drafts/one", json=draft).status_code == 204
            code = {"code": service.access.code(), "name": "page"}
            token = rest.post("/pair", json=code, headers=PAGE).json()["token"]
            known = doors(service, service.access.code(), token)
            described = rest.get("/openapi.json").json()["paths"]
            writing = {
                (method, path)
                for path, methods in described.items()
                for method in methods
                if method in ("put", "post", "delete")
                and path.startswith(("/v1/layouts", "/v1/drafts", "/v1/person", "/v1/pair",
                                     "/v1/assets"))
            }  # fmt: skip
            assert writing == known.keys() | MOVES
            full()
            for (method, _), (path, body, more) in known.items():
                as_json = {"content" if isinstance(body, bytes) else "json": body}
                answer = rest.request(method, path, headers=more, **as_json)
                assert answer.status_code == 507, (method, path, answer.text)
                assert "MB free; make room" in answer.json()["sentence"]
            assert rest.get("/layouts").json() == ["desk"]
            assert rest.get("/layouts/desk").json() == LAYOUT
            assert rest.get("/drafts/one").status_code == 200
    finally:
        service.close()
    assert "Traceback" not in "".join(capfd.readouterr())


def test_a_worker_that_cannot_keep_pixels_says_so(tmp_path, full, monkeypatch):
    store = AssetStore(tmp_path / "assets")
    digest = kept(store, bomb(1))
    monkeypatch.setattr(decoded, "_place", None)
    decoded.keep_in(tmp_path / decoded.FOLDER, makes=True)
    full()
    with pytest.raises(FileFormatError, match=r"cannot keep the pixels .* make room"):
        DocumentWork(store.folder, OPENING).decode(digest)


def test_a_second_service_leaves_the_folder_to_the_first(tmp_path):
    (tmp_path / "results").mkdir()
    (tmp_path / "service.json").write_text("{}")
    with (
        FileLock(tmp_path / "service.lock"),
        pytest.raises(InputError, match=r"one runs with it; .* HAPTIX_SERVICE"),
    ):
        serve(port=0, folder=tmp_path)
    assert (tmp_path / "results").is_dir()
    assert (tmp_path / "service.json").read_text() == "{}"


@pytest.mark.parametrize("where", ["Access", "AssetStore.keep"])
def test_a_service_that_cannot_write_its_folder_does_not_start(tmp_path, monkeypatch, where):
    def fails(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(f"haptix.service.front.startup.{where}", fails)
    with pytest.raises(InputError, match=r"service's folder .* make room"):
        serve(port=0, folder=tmp_path)
