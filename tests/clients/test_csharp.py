"""The C# client, compiled as C# 6 and run under Mono, against the real front."""

import os
import re
import runpy
import subprocess

from haptix.feel.materials import material_of
from haptix.service.front.jobs import Job
from haptix.service.protocol.messages import JobMessage, LayoutDocument
from tests.clients.compiled import compiled, compiled_for_unity
from tests.made_clients import CSHARP, ROOT, make_clients
from tests.waiting import PATIENCE_S, wait_for


def test_client(service, tmp_path):
    program = compiled(tmp_path / "test.exe", CSHARP / "Test~")
    watched = JobMessage(job="a1", kind="surface", state="running")
    service.hub.jobs.jobs["a1"] = Job("programs", watched, {}, lambda _: None)
    folder = service.access.folder
    done = subprocess.run(
        ["mono", program, CSHARP.parent / "golden"],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        env=os.environ | {"HAPTIX_SERVICE": str(folder)},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    reports = service.engine.reports
    place = (10.0 + 40.0 / 4.0, 5.0)
    wait_for(lambda: place in [(report.x_mm, report.y_mm) for report in reports])
    by_mm = wait_for(lambda: next((one for one in reports if one.touch_id == 5), None))
    assert by_mm[2:] == (3.0, 4.0, "down", 0.5, None)
    told = [fields["ops"][0] for do, fields, _ in service.engine.told if do == "layout_change"]
    added, moved, changed, valued, removed = [op for op in told if op["name"] == "region 1"]
    options = {"x_mm": 1.0, "y_mm": 2.0, "width_mm": 60.0, "opacity": 0.5}
    material = {"kind": "grating", "period_mm": 2.0}
    assert added == {"op": "add", "name": "region 1", "material": material} | options
    assert moved == {"op": "move", "name": "region 1", "x_mm": 5.0, "over_s": 0.1}
    assert changed == {"op": "change", "name": "region 1", "opacity": 1.0}
    assert valued == {"op": "value", "name": "region 1", "value": 0.5}
    assert removed == {"op": "remove", "name": "region 1"}


SAMPLE = CSHARP / "Samples~" / "Ribs"


def test_unity_s_package_compiles_as_unity_would(tmp_path):
    code = compiled_for_unity(tmp_path, "legacy").with_name("Haptix.dll").read_bytes()
    for name in (b"System.Reflection.Emit", b"System.Linq.Expressions", b"MakeGeneric"):
        assert name not in code  # IL2CPP compiles ahead of time


def test_il2cpp_sees_each_collection_of_numbers_and_keeps_each_field():
    make_clients()
    made = "".join((CSHARP / f"{name}.cs").read_text() for name in ("Messages", "Materials"))
    fields = re.findall(r"\n +(\[.*\] )?public (\S+(?: \S+)?) \w+ \{ get; set; \}", made)
    assert len(fields) > 200
    assert all("Preserve" in attribute for attribute, _ in fields)
    collections = {
        kind for _, kind in fields if re.match(r"(double|long|bool)\??\[|Dictionary", kind)
    }
    of_objects = {"Dictionary<string, string[]>"}
    assert collections - of_objects == {"double[]", "double[][]", "Dictionary<string, double>"}
    kept = (CSHARP / "Session.cs").read_text()
    assert "Kept = { new List<double>(), new Dictionary<string, double>() }" in kept


def test_the_sample_s_scene_names_files_of_the_package():
    script = runpy.run_path(str(ROOT / "scripts" / "make-clients.py"))
    scene, component = (
        (SAMPLE / "Ribs.unity").read_text(),
        CSHARP / "Unity" / "LayoutUnderFinger.cs",
    )
    files = (component, SAMPLE / "LogContacts.cs", SAMPLE / "layout.json")
    named = set(re.findall(r"guid: (\w{32})", scene))
    assert named == {script["unity_id"](path) for path in files}
    fields = r"^        public (?!event)[^(\n]+? (\w+)(?: =.*)?;$"
    shown = re.search(r"m_EditorClassIdentifier:\n((?:  \w.*\n)+)", scene)
    values = set(re.findall(r"^  (\w+):", shown[1], re.MULTILINE))
    region = {"name", "material", "placeMm", "opacity"}
    assert values == set(re.findall(fields, component.read_text(), re.MULTILINE)) - region


def test_the_sample_s_layout_is_taken():
    text = (SAMPLE / "layout.json").read_text()
    for region in LayoutDocument.model_validate_json(text).regions:
        material_of(region.material)
