"""The clients' types are those of today's messages."""

import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOLS = ROOT / "clients" / "typescript" / "node_modules"


def test_what_types_are_made_from_is_what_it_was():
    script = runpy.run_path(str(ROOT / "scripts" / "make-client-types.py"))
    kept = (ROOT / "clients" / "types-made-from").read_text().strip()
    assert kept == script["made_from"](), "run scripts/make-client-types.py"


@pytest.mark.slow  # the generators take long; the test above sees what they would change
def test_types_are_up_to_date(tmp_path):
    if shutil.which("node") is None or not (TOOLS / "quicktype").exists():
        pytest.skip("needs node, and npm ci in clients/typescript")
    script = ROOT / "scripts" / "make-client-types.py"
    # tsc checks the JavaScript meanwhile, and a wrong type ends the script.
    subprocess.run([sys.executable, script, tmp_path], check=True)
    made = {path.name: path.read_text() for path in tmp_path.iterdir()}
    folders = (ROOT / "clients" / "typescript" / "types", ROOT / "clients" / "csharp")
    kept = {name: path for folder in folders for path in folder.iterdir() if (name := path.name)}
    assert {"messages.d.ts", "haptix.d.ts", "Messages.cs"} <= made.keys()
    for name, text in made.items():
        assert kept[name].read_text() == text, f"{name}: run scripts/make-client-types.py"
