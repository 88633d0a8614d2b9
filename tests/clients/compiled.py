"""Compiles the C# client as C# 6."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.made_clients import CSHARP, make_clients

JSON = Path("/usr/lib/cli/Newtonsoft.Json-5.0/Newtonsoft.Json.dll")


def compiled(target, *folders):
    """Compile the client and what is in `folders`; return the target."""
    make_clients()
    return compiled_sources(target, [CSHARP, *folders], [])


def compiled_sources(target, folders, assemblies, defines=()):
    """Compile folders against assemblies; return the target.

    Without mcs's own list of assemblies: `dynamic` needs Microsoft.CSharp, which IL2CPP lacks.
    """
    if shutil.which("mcs") is None or shutil.which("mono") is None or not JSON.exists():
        pytest.skip("needs mono-mcs, mono-runtime and libnewtonsoft-json5.0-cil of Debian")
    sources = [path for folder in folders for path in sorted(folder.glob("*.cs"))]
    kind = "library" if target.suffix == ".dll" else "exe"
    options = ["-noconfig", "-langversion:6", "-warn:4", "-warnaserror"]
    options += [f"-define:{one}" for one in defines]
    options += [f"-r:{one}" for one in ("System.dll", "System.Core.dll", JSON, *assemblies)]
    command = ["mcs", *options, f"-target:{kind}", f"-out:{target}", *sources]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    shutil.copy(JSON, target.parent)
    return target


INPUT_SYSTEMS = {
    "legacy": ["ENABLE_LEGACY_INPUT_MANAGER"],
    "new": ["ENABLE_INPUT_SYSTEM", "HAPTIX_INPUT_SYSTEM"],
    "both": ["ENABLE_LEGACY_INPUT_MANAGER", "ENABLE_INPUT_SYSTEM", "HAPTIX_INPUT_SYSTEM"],
}
"""What Unity defines, and the package's asmdef, by a project's setting."""


def compiled_for_unity(folder, inputs):
    """Compile three assemblies: Unity's (stubs), the package's, and a player's with the sample."""
    make_clients()
    (folder / "stubs").mkdir()
    shutil.copy(CSHARP / "Test~" / "UnityStubs.cs", folder / "stubs")
    unity = compiled_sources(folder / "UnityEngine.dll", [folder / "stubs"], [])
    sources = [CSHARP, CSHARP / "Unity"]
    package = compiled_sources(folder / "Haptix.dll", sources, [unity], INPUT_SYSTEMS[inputs])
    project = [CSHARP / "Samples~" / "Ribs", CSHARP / "Test~" / "Unity"]
    return compiled_sources(folder / "Player.exe", project, [unity, package])
