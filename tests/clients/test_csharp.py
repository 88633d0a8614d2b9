"""The C# client, compiled as C# 6 and run under Mono, against the real front."""

import os
import shutil
import subprocess

from haptix.service.jobs import Job
from haptix.service.messages import JobMessage
from tests.clients.compiled import compiled
from tests.made_clients import CSHARP
from tests.waiting import PATIENCE_S, wait_for


def test_client(service, tmp_path):
    program = compiled(tmp_path / "test.exe", CSHARP / "Test")
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


def test_example_compiles_without_unity(tmp_path):
    stubs = tmp_path / "stubs"
    stubs.mkdir()
    shutil.copy(CSHARP / "Test" / "UnityStubs.cs", stubs)
    compiled(tmp_path / "example.dll", CSHARP / "Example", stubs)
