"""Empty libraries in place of NVIDIA's, for a torch of CUDA that computes on the processor alone.

    .venv/bin/python scripts/without_cuda.py SITE-PACKAGES/torch/lib

Each has the functions that torch's libraries ask of it, under the versions that they ask for; all
return 100, which is "no device". `scripts/other-python.sh` says why.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

NVIDIA = re.compile(r"lib(cu|nv|nccl)")
NEEDED = re.compile(r"\(NEEDED\) .*\[(.+)\]")
VERSION_OF = re.compile(r" File: (\S+) ")
VERSION = re.compile(r" Name: (\S+) ")
FUNCTION = re.compile(r" UND (_*(?:cu|nccl|nv)\w+)(?:@(\S+))?")


def main(folder: Path) -> None:
    """Write a library for each that is asked for."""
    versions: dict[str, set[str]] = defaultdict(set)  # of a library
    functions: dict[str, set[str]] = defaultdict(set)  # of a version; of none: ""
    for library in folder.glob("*.so"):
        told = subprocess.run(
            ["readelf", "-W", "-d", "-V", "--dyn-syms", library],
            capture_output=True, text=True, check=True,
        ).stdout  # fmt: skip
        of = ""
        for line in told.splitlines():
            if found := NEEDED.search(line):
                versions[found[1]] |= set()
            elif found := VERSION_OF.search(line):
                of = found[1]
            elif of and (found := VERSION.search(line)):
                versions[of].add(found[1])
            elif found := FUNCTION.search(line):
                functions[found[2] or ""].add(found[1])
    for name in filter(NVIDIA.match, versions):
        own = versions[name] or {""}
        code = "".join(f"int {one}(void) {{ return 100; }}\n" for v in own for one in functions[v])
        script = "".join(f"{v} {{ global: {'; '.join(functions[v])}; }};\n" for v in own if v)
        with tempfile.TemporaryDirectory() as work:
            (Path(work) / "empty.c").write_text(code)
            (Path(work) / "versions").write_text(script)
            more = [f"-Wl,--version-script={work}/versions"] if script else []
            subprocess.run(
                ["cc", "-shared", "-fPIC", "-fno-builtin", f"-Wl,-soname,{name}", *more,
                 "-o", folder / name, f"{work}/empty.c"],
                check=True,
            )  # fmt: skip


if __name__ == "__main__":
    main(Path(sys.argv[1]))
