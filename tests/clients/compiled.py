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


def compiled_sources(target, folders, assemblies):
    """Compile folders against assemblies; return the target.

    Without mcs's own list of assemblies: `dynamic` needs Microsoft.CSharp, which IL2CPP lacks.
    """
    if shutil.which("mcs") is None or shutil.which("mono") is None or not JSON.exists():
        pytest.skip("needs mono-mcs, mono-runtime and libnewtonsoft-json5.0-cil of Debian")
    sources = [path for folder in folders for path in sorted(folder.glob("*.cs"))]
    kind = "library" if target.suffix == ".dll" else "exe"
    options = ["-noconfig", "-langversion:6", "-warn:4", "-warnaserror"]
    options += [f"-r:{one}" for one in ("System.dll", "System.Core.dll", JSON, *assemblies)]
    command = ["mcs", *options, f"-target:{kind}", f"-out:{target}", *sources]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    shutil.copy(JSON, target.parent)
    return target
