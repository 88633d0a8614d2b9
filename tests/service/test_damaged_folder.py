"""A used service's folder, each file of which is damaged: a sentence, or it begins anew."""

import hashlib
import io
import json
import os
import shutil
import subprocess
import sys
from contextlib import contextmanager

import httpx
import numpy as np
import pytest
from PIL import Image

from haptix.base.errors import HaptixError
from haptix.feel.materials import decoded
from haptix.feel.materials.pictures import read_grey
from haptix.service.client.connection import _service_file, _word_of
from haptix.service.engine.session_layout import SessionLayout
from haptix.service.front.access import Access
from haptix.service.front.assets import AssetStore
from haptix.service.front.pool import Pool
from haptix.service.front.rest import documents_router
from haptix.service.worker.document_work import DocumentWork
from haptix.tasks.login import running_service
from tests.service.service_under_test import Service, is_reached
from tests.waiting import PATIENCE_S, wait_for

PAGE = "https://example.org"
OPENING = {"surface": None, "finger": "semi-wet", "screen": "3m-sct3250"}
DAMAGES = {
    "emptied": lambda content: b"",
    "cut": lambda content: content[: len(content) // 2],
    "null": lambda content: b"null",
    "list": lambda content: b"[]",
    "object": lambda content: b"{}",
    "nested": lambda content: b"[" * 100_000,
    "bytes": lambda content: b"\xff" * 200,
}


def picture():
    pixels = np.random.default_rng(1).integers(0, 255, (30, 40), dtype=np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "png")
    return file.getvalue()


PICTURE = picture()
DIGEST = hashlib.sha256(PICTURE).hexdigest()
LAYOUT = {
    "regions": [
        {
            "name": "a",
            "material": {"kind": "photograph", "file": f"sha256:{DIGEST}", "width_mm": 40.0},
        }
    ]
}


@contextmanager
def serving(folder):
    """A service in this process, and a program of this user."""
    service = Service(folder, documents_router(Pool({}), folder / "layouts", is_reached))
    headers = {"authorization": f"Bearer {service.access.native}"}
    base = f"http://127.0.0.1:{service.port}/v1"
    try:
        with httpx.Client(base_url=base, headers=headers, timeout=PATIENCE_S) as rest:
            yield service, rest
    finally:
        service.close()


def sends(service, rest):
    """Use all that is kept; return the status of sending the picture."""
    status = rest.put(f"/assets/{DIGEST}?suffix=.png", content=PICTURE).status_code
    DocumentWork(service.folder / "assets", OPENING).decode(DIGEST)
    layout = SessionLayout(service.folder / "assets")
    layout.set(LAYOUT)
    return status


@pytest.fixture(scope="module")
def used(tmp_path_factory):
    """The folder of a service that was used in every way that leaves a file."""
    folder = tmp_path_factory.mktemp("used")
    decoded.keep_in(folder / decoded.FOLDER, makes=True)
    with serving(folder) as (service, rest), pytest.MonkeyPatch.context() as patch:
        patch.setenv("HAPTIX_SERVICE", str(folder))
        access = service.access
        access.pair(access.code(), PAGE, "page")
        access.write_entrance("http://127.0.0.1")
        assert (
            rest.put("/person", json={"person_intensity": 0.5, "person_muted": False}).status_code
            == 204
        )
        first = rest.put("/layouts/desk", json={"regions": []}).headers["etag"]
        rest.put("/layouts/desk", json=LAYOUT, headers={"if-match": first})
        gone = rest.put("/layouts/gone", json=LAYOUT).headers["etag"]
        assert rest.delete("/layouts/gone", headers={"if-match": gone}).status_code == 204
        draft = {"name": "desk", "made_from": 1, "document": LAYOUT}
        assert rest.put("/drafts/one", json=draft).status_code == 204
        assert sends(service, rest) == 201
        _word_of("app")
        shutil.copy(folder / "service.json", folder / "kept.json")
    (folder / "kept.json").rename(folder / "service.json")  # as a kill leaves it
    decoded._place = None
    return folder


def files(folder):
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


def test_the_used_folder_has_files_of_all_kinds(used):
    first = {path.parts[0] for path in files(used)}
    assert first == {
        "apps", "assets", "decoded", "drafts", "layouts", "person.json", "service.json",
        "studio.html", "tokens.json",
    }  # fmt: skip


def check(service, rest):
    """Read all over REST: each answer is whole, or a sentence."""
    said = {}

    def get(route, *fields):
        answer = rest.get(route)
        assert answer.status_code in (200, 404, 422), (route, answer.text)
        body = answer.json()
        if answer.status_code != 200:
            assert len(body["sentence"]) > 20
            said[route] = body["sentence"]
        elif fields:
            assert {field: type(body[field]) for field, _ in fields} == dict(fields), route
        return body

    get("/server")
    assert 0 <= get("/person")["person_intensity"] <= 1
    names = [*get("/layouts"), *get("/layouts?removed=true")]
    assert set(names) == {"desk", "gone"}
    for name in names:
        get(f"/layouts/{name}", ("regions", list))
        for version in get(f"/layouts/{name}/versions"):
            get(f"/layouts/{name}/versions/{version['revision']}", ("regions", list))
    for draft in get("/drafts"):
        get(f"/drafts/{draft['name']}", ("name", str), ("document", dict))
    assert sends(service, rest) in (200, 201)
    return said


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize(
    "each", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["all", "each"]
)
def test_files_of_a_used_service_may_be_damaged(used, tmp_path, monkeypatch, damage, each):
    known = files(used)
    for number, group in enumerate([[file] for file in known] if each else [known]):
        shutil.copytree(used, folder := tmp_path / str(number))
        before = {file: (folder / file).read_bytes() for file in group}
        after = {file: DAMAGES[damage](content) for file, content in before.items()}
        for file, content in after.items():
            (folder / file).write_bytes(content)
        decoded.keep_in(folder / decoded.FOLDER, makes=True)
        monkeypatch.setenv("HAPTIX_SERVICE", str(folder))
        parts = {file.parts[0] for file in group}
        if "service.json" in parts:  # its readers; a service writes it anew
            assert running_service() is None
            with pytest.raises(HaptixError, match="haptix serve"):
                _service_file()
        with serving(folder) as (service, rest):
            said = check(service, rest)
            for file in group:
                if file.parts[0] == "layouts" and b"removed" not in before[file]:
                    route = f"/layouts/{file.parts[1]}/versions/{file.stem}"
                    assert "damaged" in said[route]
            assert ("drafts" in parts) == ("damaged" in said.get("/drafts/one", ""))
            assert service.access.is_known_origin(PAGE) == ("tokens.json" not in parts)
            word = _word_of("app")
            assert len(word) == 22 and _word_of("app") == word
        for file in group:
            kind = file.parts[0]
            left = (folder / file).read_bytes() if (folder / file).exists() else b""
            if kind in ("assets", "decoded"):
                assert left == before[file], file  # sent, or decoded, again
            elif kind in ("service.json", "apps"):
                assert left != after[file]  # written anew
            elif kind == "person.json" or (kind == "tokens.json" and damage != "object"):
                aside = folder / f"{kind}.damaged"
                assert not left and aside.read_bytes() == after[file]


def test_an_engine_says_of_damaged_pixels_that_they_are_to_be_decoded_anew(used, tmp_path):
    shutil.copytree(used, folder := tmp_path / "service")
    store = AssetStore(folder / "assets")
    (kept,) = (folder / decoded.FOLDER).iterdir()
    kept.write_bytes(kept.read_bytes()[:200])
    decoded.keep_in(folder / decoded.FOLDER, makes=False)
    try:
        with pytest.raises(HaptixError, match="send the layout again"):
            read_grey(store.path(DIGEST))
        assert not decoded.is_kept(folder / decoded.FOLDER, DIGEST)  # so a worker decodes it
    finally:
        decoded._place = None


MAIN = "from haptix.tasks.cli import main; main()"


def served(folder, *options, **environment):
    return subprocess.Popen(
        [sys.executable, "-c", MAIN, "serve", "--port", "0", "--device", "mock:", *options],
        env=os.environ | {"HAPTIX_SERVICE": str(folder), **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@pytest.mark.slow  # starts the whole service
def test_a_service_starts_where_all_its_files_are_empty(used, tmp_path):
    shutil.copytree(used, folder := tmp_path / "service")
    for file in files(folder):
        (folder / file).write_bytes(b"")
    with served(folder) as process:
        try:
            wait_for(lambda: (folder / "service.json").read_bytes())
            entry = json.loads((folder / "service.json").read_bytes())
            headers = {"authorization": f"Bearer {entry['token']}"}
            base = f"http://127.0.0.1:{entry['port']}/v1"

            def answers():
                try:
                    return httpx.get(f"{base}/server", headers=headers).status_code == 200
                except httpx.TransportError:
                    return False

            wait_for(answers)
        finally:
            process.terminate()
            said, _ = process.communicate(timeout=PATIENCE_S)
    assert "Traceback" not in said
    assert "tokens.json is damaged" in said and "person.json is damaged" in said


BROKEN = """
import sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r} and "engine" in " ".join(sys.orig_argv):
            raise OSError("wrong ELF class")
sys.meta_path.insert(0, Finder())
"""


@pytest.mark.parametrize(
    ("module", "words"),
    [
        pytest.param("haptix.base.native", "cannot load: wrong ELF class", marks=pytest.mark.slow),
        ("haptix.service.engine.touch_gate", "ended before it was there"),
    ],
)
def test_a_service_whose_engine_cannot_start_ends_with_a_sentence(tmp_path, module, words):
    (tmp_path / "sitecustomize.py").write_text(BROKEN.format(module=module))
    with served(tmp_path / "service", PYTHONPATH=str(tmp_path)) as process:
        said, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert words in said.splitlines()[-1], said


def test_a_token_file_that_stays_is_no_way_in(used, tmp_path):
    """One that a kill has left behind names a token that no service has."""
    shutil.copytree(used, folder := tmp_path / "service")
    old = json.loads((folder / "service.json").read_bytes())["token"]
    access = Access(1, folder)
    assert not access.lets_in(old, None) and access.lets_in(access.native, None)
