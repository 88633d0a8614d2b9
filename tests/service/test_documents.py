"""Gallery, kept layouts, pictures, checks and exports over REST, and the process behind them."""

import asyncio
import base64
import io
import json
import os
import subprocess
import sys
import zipfile

import httpx
import numpy as np
import pytest
from fastapi import Depends

import haptix
from haptix.feel.gallery import ASSETS, load, presets
from haptix.lab.stimuli.interchange import FrictionMap
from haptix.service.front import pool as pool_module
from haptix.service.front.assets import AssetStore
from haptix.service.front.pool import Pool
from haptix.service.front.rest import KeptTexts, documents_router
from haptix.service.front.startup import inventory_of
from haptix.service.protocol.messages import Problem
from haptix.service.worker.document_work import DocumentWork, surface_of
from haptix.service.worker.process import JobWork
from tests.service.service_under_test import Service, is_reached
from tests.service.test_drive import is_a_program
from tests.waiting import PATIENCE_S

OPENING = {"surface": None, "finger": "semi-wet", "screen": "3m-sct3250"}
RIBS = {"kind": "grating", "period_mm": 4.0}
LAYOUT = {"regions": [
    {"name": "a", "material": RIBS, "x_mm": 2, "y_mm": 1, "width_mm": 40, "height_mm": 20},
    {"name": "b", "material": {"kind": "button"}, "x_mm": 50, "y_mm": 0},
]}  # fmt: skip


@pytest.fixture(scope="module")
def reach():
    """Lowest and highest friction at half a newton."""
    return tuple(float(end) for end in surface_of(OPENING).at(4000.0).reachable(0.5))


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """What the process answers, in this process."""
    store = AssetStore(tmp_path_factory.mktemp("store") / "assets")
    store.keep(ASSETS)
    return DocumentWork(store.folder, OPENING)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("served")


@pytest.fixture(scope="module")
def rest(folder):
    """A client of a service whose documents are served, and the workers behind."""
    pool = Pool({**OPENING, "assets": str(folder / "assets")}, longest_s=PATIENCE_S)
    service = Service(folder, documents_router(pool, folder / "layouts", is_reached))
    headers = {"authorization": f"Bearer {service.access.native}"}
    base = f"http://127.0.0.1:{service.port}/v1"
    with pytest.MonkeyPatch.context() as patch, httpx.Client(base_url=base, headers=headers) as one:
        patch.setattr(pool_module, "START_S", PATIENCE_S)
        patch.setattr(pool_module, "NICE", 1)  # other tests leave little for who yields
        yield one
    pool.end()
    service.close()


def test_the_gallery_is_whole_and_needs_a_token(rest):
    found = rest.get("/gallery").json()
    assert [one["name"] for one in found] == [one.name for one in presets()]
    assert found[0]["document"] == presets()[0].document
    assert base64.b64decode(found[0]["thumbnail"].split(",")[1]).startswith(b"\x89PNG")
    assert httpx.get(f"{rest.base_url}gallery").status_code == 403


def test_a_layout_is_kept_and_two_writers_do_not_lose_each_other_s_work(rest):
    assert rest.get("/layouts").json() == []
    assert rest.put("/layouts/my desk", json=LAYOUT).status_code == 204
    first = rest.get("/layouts/my desk")
    assert [one["name"] for one in first.json()["regions"]] == ["a", "b"]
    seen = {"if-match": first.headers["etag"]}
    more = {"regions": LAYOUT["regions"][:1]}
    done = rest.put("/layouts/my desk", json=more, headers=seen)
    assert done.status_code == 204
    assert done.headers["etag"] != first.headers["etag"]
    late = rest.put("/layouts/my desk", json=LAYOUT, headers=seen)
    assert late.status_code == 412
    assert "meanwhile" in late.json()["sentence"]
    assert rest.get("/layouts").json() == ["my desk"]
    assert rest.put("/layouts/my desk", json=LAYOUT).status_code == 412  # it was not read before
    assert rest.delete("/layouts/my desk", headers=seen).status_code == 412
    now = {"if-match": done.headers["etag"]}
    again = rest.put("/layouts/my desk", json=more, headers=seen)  # its answer was lost
    assert again.headers["etag"] == now["if-match"]
    assert rest.delete("/layouts/my desk", headers=now).status_code == 204
    assert rest.get("/layouts/my desk").status_code == 404
    gone = rest.put("/layouts/my desk", json=LAYOUT, headers=now)
    assert gone.status_code == 412
    assert "removed or renamed" in gone.json()["sentence"]


def test_versions_of_a_layout_are_kept_and_follow_its_name(rest):
    """An earlier version is read again, also of a layout that was renamed or removed."""
    header, etags = {}, []
    for count in (0, 1, 2):
        document = {"regions": LAYOUT["regions"][:count]}
        done = rest.put("/layouts/first", json=document, headers=header)
        header = {"if-match": done.headers["etag"]}
        etags.append(done.headers["etag"])
    assert rest.put("/layouts/second", json=LAYOUT).status_code == 204
    taken = rest.post("/layouts/first/rename", json={"to": "second"}, headers=header)
    assert taken.status_code == 409
    stale = rest.post("/layouts/first/rename", json={"to": "third"})
    assert stale.status_code == 412
    done = rest.post("/layouts/first/rename", json={"to": "third"}, headers=header)
    assert done.status_code == 204
    assert {"second", "third"} <= set(rest.get("/layouts").json())
    assert rest.delete("/layouts/third", headers=header).status_code == 204
    assert "third" in rest.get("/layouts?removed=true").json()
    found = rest.get("/layouts/third/versions").json()
    assert [f'"{one["revision"]}"' for one in found] == etags[::-1]
    middle = rest.get(f"/layouts/third/versions/{found[1]['revision']}").json()
    assert [one["name"] for one in middle["regions"]] == ["a"]
    # Another one takes the name of a removed one, whose versions stay.
    second = {"if-match": rest.get("/layouts/second").headers["etag"]}
    moved = rest.post("/layouts/second/rename", json={"to": "third"}, headers=second)
    assert moved.status_code == 204
    assert "third" not in rest.get("/layouts?removed=true").json()
    assert len(rest.get("/layouts/third 2/versions").json()) == 3


def test_a_name_that_a_rename_has_left_gives_no_revision_twice(rest):
    old = {"if-match": rest.put("/layouts/left", json={"regions": []}).headers["etag"]}
    moved = rest.post("/layouts/left/rename", json={"to": "elsewhere"}, headers=old)
    assert moved.status_code == 204
    other = rest.put("/layouts/left", json=LAYOUT)  # of another app
    assert other.status_code == 204
    assert rest.put("/layouts/left", json={"regions": []}, headers=old).status_code == 412
    assert rest.get("/layouts/left").headers["etag"] == other.headers["etag"]


@pytest.mark.parametrize("kind", ["application/x-www-form-urlencoded", None])
def test_a_body_without_its_content_type_is_refused_with_what_to_send(rest, kind):
    headers = {"content-type": kind} if kind else {}
    refused = rest.put("/layouts/curl", content=b'{"regions": []}', headers=headers)
    assert refused.status_code == 422
    assert "content-type: application/json" in refused.json()["sentence"]


def test_clients_are_not_told_where_the_token_of_a_driver_lies():
    opened = {
        "device": "served", "is_real": False, "finger": "wet", "screen": "3m-sct3250",
        "screen_mm": (100.0, 60.0), "kinds": (),
    }  # fmt: skip
    for address in ("tcp:localhost:7420,token_file=/home/a/secret", "tcp:localhost:7420"):
        (device,) = inventory_of(address, opened).devices
        assert device.address == "tcp:localhost:7420"


def test_what_a_kill_left_half_written_goes_at_the_next_start(tmp_path):
    old, new = tmp_path / "layouts" / "desk" / ".2.json.ab.part", tmp_path / ".person.json.cd.part"
    old.parent.mkdir(parents=True)
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (0, 0))
    Service(tmp_path).close()
    assert not old.exists()
    assert new.exists()  # of this minute: another process may be writing it


def test_layouts_of_an_earlier_version_open(tmp_path):
    """A file per layout, and fields that are not known any more: nothing is refused or lost."""
    kept = tmp_path / "my desk.json"
    kept.write_text('{"regions":[],"former":1}')
    for _ in range(2):  # at each start of the service
        store = KeptTexts(tmp_path)
        assert store.names() == ["my desk"]
        assert store.read("my desk") == ('{"regions":[],"former":1}', 1)
    kept.write_text('{"regions":[]}')  # put there by hand
    assert KeptTexts(tmp_path).read("my desk") == ('{"regions":[]}', 2)


@pytest.mark.parametrize(
    "damage", [lambda data: data[: len(data) // 2], lambda data: data[:-1] + b"\xff"]
)
def test_a_damaged_version_is_named_and_an_earlier_one_is_read(tmp_path, damage):
    store = KeptTexts(tmp_path)
    store.write("desk", '{"regions":[]}', None)
    store.write("desk", '{"regions":[{"name":"a"}]}', '"1"')
    (path,) = tmp_path.glob("desk/2.json")
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(Problem, match="revision 2 of 'desk' is damaged"):
        store.read("desk")
    assert store.read("desk", 1) == ('{"regions":[]}', 1)
    assert store.write("desk", '{"regions":[{"name":"b"}]}', '"2"') == 3


def test_only_the_newest_versions_and_drafts_are_kept(tmp_path, monkeypatch):
    store = KeptTexts(tmp_path, most_versions=3)
    revision = None
    for number in range(7):
        revision = f'"{store.write("a", str(number), revision)}"'
    assert [store.read("a", one.revision)[0] for one in store.versions("a")] == ["6", "5", "4"]
    monkeypatch.setattr("haptix.service.front.rest.MOST_REMOVED", 2)
    for number in range(4):
        kept = store.write(f"b{number}", "x", None)
        store.remove(f"b{number}", f'"{kept}"')
        os.utime(tmp_path / f"b{number}" / f"{kept + 1}.json", (number, number))
    assert store.names(are_removed=True) == ["b2", "b3"]


@pytest.mark.parametrize("name", ["..", "%2e%2e%2fservice", ".hidden", "a/b", "x" * 81])
def test_a_name_that_could_leave_the_folder_is_refused(rest, name, folder):
    before = sorted(folder.rglob("*"))
    assert rest.put(f"/layouts/{name}", json=LAYOUT).status_code in (404, 405, 422)
    assert sorted(folder.rglob("*")) == before


def shares(answer):
    """Shares of a picture, from its bytes."""
    levels = np.frombuffer(base64.b64decode(answer["levels"]), np.uint8).astype(float)
    return (levels / 127.5 - 0.5).reshape(answer["rows"], answer["columns"])


def test_a_picture_is_what_the_material_asks_for(work, reach):
    found = work.picture(RIBS, 8.0, 4.0, 80, 0.0, reach)
    share = shares(found)
    assert share.shape == (40, 80)
    x = (np.arange(80) + 0.5) * 0.1
    expected = 0.5 + 0.5 * np.sin(2 * np.pi * x / 4)
    np.testing.assert_allclose(share, np.tile(expected, (40, 1)), atol=0.005)  # half a byte's step
    assert found["below"] == found["above"] == 0.0
    low, high = found["lowest_mu"], found["highest_mu"]
    # Half of the places ask for more than the screen can give, in friction coefficients.
    above = {
        "kind": "grating",
        "period_mm": 4.0,
        "target": "mu",
        "low": low,
        "high": 2 * high - low,
    }
    assert work.picture(above, 8.0, 4.0, 80, 0.0, reach)["above"] == pytest.approx(0.5, abs=0.02)


WITHOUT_TORCH = """
import json, sys
from pathlib import Path
from haptix.service.worker.document_work import DocumentWork
opening, reach, material = json.loads(sys.argv[1])
work = DocumentWork(Path(), opening)
found = [work.picture(material, 8.0, 4.0, 80, 0.0, reach), work.check(material, reach)]
assert "torch" not in sys.modules
print(json.dumps(found))
"""


def test_what_pages_ask_for_is_answered_without_torch(work, reach):
    command = [sys.executable, "-c", WITHOUT_TORCH, json.dumps([OPENING, reach, RIBS])]
    found = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    assert found == [work.picture(RIBS, 8.0, 4.0, 80, 0.0, reach), work.check(RIBS, reach)]


def test_a_question_at_any_force_brings_the_friction_that_the_engine_knows(tmp_path):
    """No worker loads a surface for it, so that the death of one delays a question by 2 s at most.

    The engine is asked once for each force: while it is started again, what it told still holds.
    """
    asked = []

    class PoolHere:
        async def ask(self, owner, do, **fields):
            asked.append((do, fields["reachable_mu"], "normal_force_n" in fields))
            raise Problem("document", "enough")

    service = Service(tmp_path)
    documents = documents_router(PoolHere(), tmp_path / "layouts", service.hub.reach)
    service.app._app.include_router(documents, dependencies=[Depends(is_a_program)])
    headers = {"authorization": f"Bearer {service.access.native}"}
    try:
        for _ in range(2):
            for path, more in (
                ("pictures", {"width_mm": 9, "height_mm": 9}),
                ("materials/check", {}),
            ):
                body = {"material": RIBS, "normal_force_n": 1.25, **more}
                url = f"http://127.0.0.1:{service.port}/v1/{path}"
                assert httpx.post(url, json=body, headers=headers).json()["sentence"] == "enough"
        told = [fields for do, fields, _ in service.engine.told if do == "reach"]
    finally:
        service.close()
    assert asked == [("picture", (0.25, 0.5), False), ("check", (0.25, 0.5), False)] * 2
    assert told == [{"normal_force_n": 1.25}]


def test_a_check_tells_the_range_and_what_a_step_changes(work, reach):
    found = work.check(RIBS, reach)
    assert found["canonical"]["duty"] == 0.5
    assert found["depends_on"] == ["place"]
    jnd = (found["highest_mu"] / found["lowest_mu"] - 1) / 0.11
    assert found["range_jnd"] == pytest.approx(jnd)
    # A hundredth less at the top is at most a hundredth of the range, where friction is high.
    assert 0 < found["effects_jnd"]["high"] < 0.01 * jnd
    assert found["effects_jnd"]["duty"] == 0.0  # a sine has none
    assert found["effects_jnd"]["phase"] > found["effects_jnd"]["high"]
    noise = work.check({"kind": "noise", "pixels": 64}, reach)["effects_jnd"]
    assert "pixels" not in noise  # a power of two allows no step, which is no fault
    assert noise["mean"] > 0
    with pytest.raises(haptix.InputError, match="period_mm"):
        work.check({"kind": "grating", "period_mm": -1}, reach)


def test_currents_of_full_drive_are_those_of_the_contact_model(work):
    found = work.currents(4000.0, 150.0)
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    state = model.solve(normal_force_n=0.5, voltage_v=150.0, frequency_hz=4000.0)
    # By the capacitance of the same contact: the leak adds a little.
    least = 2 * np.pi * 4000.0 * float(state.capacitance_f) * 150.0
    at = found["normal_force_n"].index(0.5)
    assert least <= found["current_a"][at] < 1.5 * least
    assert found["current_a"] == sorted(found["current_a"])  # more contact, more current


def test_the_headroom_ends_at_the_highest_amplitude_of_the_drive_in_use(tmp_path):
    context = {"finger": "semi-wet", "screen": "3m-sct3250", "highest_v": 150.0}
    jobs = JobWork(context | {"assets": str(tmp_path)}, lambda **_: None, iter(()))
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    highest = float(model.solve(normal_force_n=0.5, voltage_v=150.0, frequency_hz=4000.0).mu)
    asked = {"kind": "grating", "period_mm": 4.0, "target": "mu", "low": highest, "high": highest}
    asked["high"] *= 1.04  # a sine over the range: all but its lowest is above
    found = jobs.headroom(material=asked, width_mm=20.0, height_mm=10.0)
    assert found["highest_mu"] == pytest.approx(highest, rel=0.11 * 0.05)  # the job's 0.05 JND
    assert found["above"] > 0.7


def unpacked(work, form, **more):
    document = {"kind": "layout", "regions": LAYOUT["regions"]}
    more = {"y_mm": 6.0, "reachable_mu": (0.3, 0.6), **more}
    answer = work.export(document=document, form=form, **more)
    return zipfile.ZipFile(io.BytesIO(base64.b64decode(answer["content"])))


def test_an_exported_document_is_felt_the_same_from_its_own_folder(work, tmp_path):
    brick = next(one for one in presets() if one.name == "brick").document
    regions = [{"name": "wall", "material": brick, "x_mm": 3, "y_mm": 2}]
    document = {"kind": "layout", "regions": regions}
    answer = work.export(document=document, form="document", reachable_mu=(0.3, 0.6))
    zipfile.ZipFile(io.BytesIO(base64.b64decode(answer["content"]))).extractall(tmp_path)
    assert len(list((tmp_path / "assets").iterdir())) == 1  # not all that the service has
    read = haptix.feel.materials.load(tmp_path / "layout.json")
    motion = haptix.Motion.of(np.linspace(3, 48, 300), 20.0)
    here = work.read({"kind": "layout", "regions": regions})
    np.testing.assert_array_equal(read.wanted(motion), here.wanted(motion))


def test_an_exported_map_is_the_friction_at_each_place(work, tmp_path):
    unpacked(work, "friction-map").extractall(tmp_path)
    found = FrictionMap.load(tmp_path / "friction-map.png")
    pixel_mm = found.width_mm / found.values.shape[1]
    assert found.corner_mm == (2.0, 0.0)  # region a is the furthest left, b the furthest up
    low, high = 0.3, 0.6
    row = found.values[round(10 / pixel_mm), : round(30 / pixel_mm)]
    x = (np.arange(len(row)) + 0.5) * pixel_mm  # the map begins at the first region's corner
    share = (row - low) / (high - low)
    away = np.abs(share - (0.5 + 0.5 * np.sin(2 * np.pi * x / 4)))
    assert away[x > 0.5].max() < 0.02  # behind the region's own edge


def test_an_exported_map_has_what_is_around_the_regions(work, tmp_path):
    """The groove is a strip from 17.5 to 27.5 mm, in a rough plane that is felt as well."""
    groove = load("gallery:groove").model_dump(mode="json", exclude_none=True)
    answer = work.export(document=groove, form="friction-map", reachable_mu=(0.3, 0.6))
    zipfile.ZipFile(io.BytesIO(base64.b64decode(answer["content"]))).extractall(tmp_path)
    found = FrictionMap.load(tmp_path / "friction-map.png")
    assert found.width_mm == 60.0
    rows = found.values.shape[0]
    assert rows == found.values.shape[1] // 2  # 30 mm high
    assert (
        found.values[: rows // 2].std() > 10 * found.values[round(0.65 * rows) :][: rows // 5].std()
    )


@pytest.mark.parametrize("form", ["ahap", "hjif", "wav"])
def test_a_line_is_exported_with_what_it_loses(work, form):
    archive = unpacked(work, form)
    names = archive.namelist()
    assert f"layout.{form}" in names
    if form == "wav":
        assert json.loads(archive.read("layout.json"))["peak_v"] > 10
    else:
        assert json.loads(archive.read("lost.json"))["lost"]
    with pytest.raises(haptix.InputError, match="y_mm"):
        unpacked(work, form, y_mm=500.0)


@pytest.mark.parametrize(
    "value",
    ['"\\ud800"', '{"\\udfff": 1}', '"\\u0000"', "[" * 300 + "]" * 300, "9" * 4000],
    ids=["half a character", "half a key", "nul", "deep", "long"],
)
@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("PUT", "/drafts/odd", '{"name": "odd", "document": {"a": %s}}'),
        ("PUT", "/layouts/odd", '{"regions": %s}'),
        ("POST", "/pictures", '{"material": {"a": %s}, "width_mm": 9, "height_mm": 9}'),
        ("POST", "/materials/check", '{"material": {"a": %s}}'),
        ("POST", "/exports", '{"document": {"a": %s}, "form": "wav"}'),
        ("POST", "/headroom", '{"material": {"a": %s}, "width_mm": 9, "height_mm": 9}'),
        ("POST", "/experiments", '{"recipe": {"a": %s}, "log": "x", "participant": "p"}'),
    ],
)
def test_what_no_file_may_hold_is_the_clients_fault(rest, method, path, body, value):
    """Not one of the service, which could keep it by halves or not at all."""
    json_type = {"content-type": "application/json"}
    answer = rest.request(method, path, content=body % value, headers=json_type)
    assert answer.status_code == 422
    assert "alue error" not in answer.json()["sentence"], answer.text


@pytest.mark.slow  # the process itself starts; what it answers is tested above, refusals with REST
def test_a_question_is_refused_in_one_sentence_and_the_next_is_answered(rest):
    asked = {"material": {"kind": "velvet"}, "width_mm": 10, "height_mm": 10}
    refused = rest.post("/pictures", json=asked, timeout=PATIENCE_S)
    assert refused.status_code == 422
    assert "velvet" in refused.json()["sentence"]
    answer = rest.post("/pictures", json=asked | {"material": RIBS}, timeout=PATIENCE_S)
    assert answer.json()["columns"] == 160


async def _asks(longest_s):
    pool = Pool({**OPENING, "assets": "/nowhere"}, longest_s)
    try:
        return await pool.ask("me", "decode", digest="0" * 64)
    finally:
        await pool.stop()


def test_a_question_that_takes_too_long_is_ended():
    with pytest.raises(Problem, match="took more than"):
        asyncio.run(_asks(1e-9))  # less than any answer takes
