"""Wheels with the libraries in C built: for this machine, or for the one that HAPTIX_TARGET names.

An editable installation has them built in the checkout. The description in the metadata is the
README without what leads into the repository.
"""

from __future__ import annotations

import os
import platform
import re
import sys
import sysconfig
from pathlib import Path
from runpy import run_path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any, NamedTuple

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface


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


class CustomMetadataHook(MetadataHookInterface):
    """Give the description, and the addresses where they are known."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add the README without pictures, links to files as their names, and the project's URLs.

        HAPTIX_HOME is the repository's address, and HAPTIX_EMAIL its owner's, which no file of it
        can know.
        """
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        text = re.sub(r"!\[[^\]]*\]\((?!https?:)[^)]*\)\n\n", "", text)
        text = re.sub(r"\[([^\]]*)\]\((?!https?:|#)([^)]*)\)", r"\1 (`\2`)", text)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
        email = os.environ.get("HAPTIX_EMAIL")
        metadata["authors"] = [{"name": "The haptix authors"} | ({"email": email} if email else {})]
        if home := os.environ.get("HAPTIX_HOME"):
            metadata["urls"] = {
                "Homepage": home,
                "Documentation": f"{home}/tree/main/docs",
                "Changelog": f"{home}/blob/main/CHANGELOG.md",
                "Issues": f"{home}/issues",
            }


class CustomBuildHook(BuildHookInterface[Any]):
    """Build the libraries into the wheel, or for an editable installation in the checkout."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the libraries and the tag of their platform."""
        # By its path: a build has no other file of the project to import from.
        builder = run_path(str(Path(self.root) / "c_libraries.py"))
        if version == "editable":
            for name in builder["LIBRARIES"]:
                builder["built"](name)
            return
        target = _target(os.environ.get("HAPTIX_TARGET", ""))
        self._folder = mkdtemp()
        for name, library in builder["LIBRARIES"].items():
            path = Path(self._folder) / f"{name}{target.suffix}"
            builder["compile_library"](name, path, target.triple)
            build_data["force_include"][str(path)] = f"{library.folder}/{path.name}"
        for name in builder["PICO_CORES"]:
            pico = Path(self._folder) / f"{name}.bin"
            builder["compile_pico"](name, pico)
            build_data["force_include"][str(pico)] = f"firmware_io/firmware/{pico.name}"
        build_data["tag"] = f"py3-none-{target.tag}"
        build_data["pure_python"] = False

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what is in the wheel now."""
        if version != "editable":
            rmtree(self._folder)


def _target(name: str) -> _Target:
    if name in TARGETS:
        return TARGETS[name]
    if name:
        raise ValueError(f"HAPTIX_TARGET: expected one of {', '.join(TARGETS)}, got {name!r}")
    # A Python for both kinds of Mac says universal2, but the library is for this machine's.
    own = sysconfig.get_platform().replace("universal2", platform.machine())
    suffix = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    return _Target("", re.sub(r"[-.]", "_", own), suffix)
