"""Wheels with the driver's firmware compiled, for the platform that HAPTIX_TARGET names.

The description in their metadata is the README without what leads into the repository.

Without the variable the wheel is pure: it compiles the firmware at first use where there is a
compiler, and has the reference in Python where there is none.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from runpy import run_path
from tempfile import mkdtemp
from typing import Any, NamedTuple

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

_ZIGLANG = "ziglang==0.17.0"  # a C compiler for all targets, as a package; glibc's versions too


class _Target(NamedTuple):
    triple: str
    tag: str
    suffix: str


TARGETS = {
    "linux-x86_64": _Target(
        "x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64.manylinux2014_x86_64", ".so"
    ),
    "linux-aarch64": _Target(
        "aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64.manylinux2014_aarch64", ".so"
    ),
    "windows-x86_64": _Target("x86_64-windows-gnu", "win_amd64", ".dll"),
    "macos-arm64": _Target("aarch64-macos.11.0", "macosx_11_0_arm64", ".dylib"),
    "macos-x86_64": _Target("x86_64-macos.10.13", "macosx_10_13_x86_64", ".dylib"),
}

# What a compiled firmware has no need of: its sources, and the reference that checks it.
_ONLY_IN_PURE = ("firmware_io/firmware/*.c", "firmware_io/firmware/reference*.py")


class CustomMetadataHook(MetadataHookInterface):
    """Give the description."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add the README: no pictures of the repository, and links to its files as their names."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        text = re.sub(r"!\[[^\]]*\]\((?!https?:)[^)]*\)\n\n", "", text)
        text = re.sub(r"\[([^\]]*)\]\((?!https?:|#)([^)]*)\)", r"\1 (`\2`)", text)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


class CustomBuildHook(BuildHookInterface[Any]):
    """Compile the firmware into the wheel."""

    def dependencies(self) -> list[str]:
        """Return what is needed beside hatchling."""
        return [_ZIGLANG] if os.environ.get("HAPTIX_TARGET") else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the library and the tag of its platform."""
        name = os.environ.get("HAPTIX_TARGET", "")
        if self.target_name != "wheel" or version == "editable" or not name:
            return
        if name not in TARGETS:
            raise ValueError(f"HAPTIX_TARGET: expected one of {', '.join(TARGETS)}, got {name!r}")
        target = TARGETS[name]
        library = Path(mkdtemp()) / f"haptix-firmware{target.suffix}"
        _compile(Path(self.root), target, library)
        build_data["force_include"][str(library)] = f"firmware_io/firmware/{library.name}"
        build_data["tag"] = f"py3-none-{target.tag}"
        build_data["pure_python"] = False
        self.build_config.target_config.setdefault("exclude", []).extend(_ONLY_IN_PURE)


def _compile(root: Path, target: _Target, library: Path) -> None:
    folder = root / "firmware_io" / "firmware"
    settings = run_path(str(folder / "flags.py"))  # the package itself needs its dependencies
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", target.triple, "-s"]
    if target.suffix != ".dll":
        compiler.append("-fPIC")
    sources = [str(folder / name) for name in (*settings["SOURCES"], *settings["HOST_SOURCES"])]
    subprocess.run([*compiler, *settings["FLAGS"], *sources, "-o", str(library)], check=True)
