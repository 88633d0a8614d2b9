"""Pages of the site that are made when it is built: the API reference, and files outside docs/.

A hook of mkdocs. A page of the reference shows every public name of one package; a name without
documentation fails the build.
"""

from __future__ import annotations

import json
import re
import sys
from importlib import import_module
from inspect import getdoc, isclass, ismodule, isroutine
from pathlib import Path
from typing import Any

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

import haptix
from haptix.feel.gallery import ASSETS, presets
from haptix.model.presets import DEFAULT_CARRIER_HZ
from haptix.model.surface import cached_surface
from haptix.play import ForceModel, compile_touch
from haptix.play.touch_page import engine_files

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "scripts"))
import figures  # noqa: E402  # beside this file
import gallery_pictures  # noqa: E402, F401  # the blocks of docs/gallery import it from here

FELT = "brick"
"""Preset of the gallery that the front page lets feel."""

PACKAGES = (
    "haptix", "haptix.model", "haptix.feel", "haptix.play", "haptix.plan", "haptix.lab",
    "haptix.service", "haptix.base.errors", "firmware_io", "calibration",
)  # fmt: skip
OUTSIDE = {
    "protocol.md": "firmware_io/PROTOCOL.md",
    "changelog.md": "CHANGELOG.md",
    "contributing.md": "CONTRIBUTING.md",
    "security.md": "SECURITY.md",
    "pico.md": "examples/boards/pico/README.md",
}


def public_names(package: str) -> list[str]:
    """Names that a package gives out, but its modules, which have pages of their own."""
    module = import_module(package)
    listed = getattr(module, "__all__", None) or [
        name for name, found in vars(module).items()
        if name[0] != "_" and getattr(found, "__module__", "").startswith(package)
    ]  # fmt: skip
    return [n for n in listed if n[0] != "_" and not ismodule(getattr(module, n))]


def reference(package: str) -> str:
    """Page of a package: what it is for, and each of its names."""
    module = import_module(package)
    about = getdoc(module)
    names = public_names(package)
    if not about or not names:
        raise PluginError(f"{package}: expected a docstring and public names")
    documented = [name for name in names if isclass(one := getattr(module, name)) or isroutine(one)]
    if blank := [name for name in documented if not getdoc(getattr(module, name))]:
        raise PluginError(f"{package}: no documentation of {', '.join(blank)}")
    others = {"haptix": PACKAGES[1:], "haptix.base.errors": ("firmware_io",)}.get(package, ())
    elsewhere = {
        name: other
        for other in others
        for name in public_names(other)
        if name in names and getattr(import_module(other), name) is getattr(module, name)
    }
    links = [f"[`{name}`][{_path(other, name)}]" for name, other in sorted(elsewhere.items())]
    parts = [f"Also here: {', '.join(links)}."] if links else []
    # What a client can ask stands in classes that are made, one for each form.
    calls = "\n    options:\n      inherited_members: true" if package == "haptix.service" else ""
    parts += [f"::: {_path(package, name)}{calls}" for name in names if name not in elsewhere]
    return "\n\n".join([f"# {package}", _plain(about), *parts]) + "\n"


def _path(package: str, name: str) -> str:
    """Where a name is documented: an error of `firmware_io` there."""
    home = getattr(getattr(import_module(package), name), "__module__", package)
    return f"{home if home.startswith('firmware_io') else package}.{name}"


def _plain(docstring: str) -> str:
    """Markdown of a package's docstring: literal blocks become code."""
    text = re.sub(r"``(.+?)``", r"`\1`", docstring)
    return re.sub(r"::\n\n((?:    .*\n?|\n)+)", r":\n\n\1", text)


def on_files(files: Any, config: Any) -> Any:
    """Add the pages."""
    for name, path in OUTSIDE.items():
        files.append(File.generated(config, name, content=(ROOT / path).read_text("utf-8")))
    for package in PACKAGES:
        page = f"reference/{package}.md"
        files.append(File.generated(config, page, content=reference(package)))
    for name, content in felt().items():
        files.append(File.generated(config, f"felt/{name}", content=content))
    return files


def felt() -> dict[str, bytes]:
    """Files of the texture on the front page: the engine, a picture and its program of a touch."""
    preset = next(preset for preset in presets() if preset.name == FELT)
    picture = ASSETS / f"{preset.document['file'].removeprefix('sha256:')}.jpg"
    model = haptix.ContactModel(haptix.Finger(), haptix.Screen())
    # A page knows no force: one that is assumed does.
    scene = {"normal_force_n": ForceModel().assumed_n, "frequency_hz": DEFAULT_CARRIER_HZ}
    surface, _ = cached_surface(model, scene, "0.05 JND")
    with haptix.open_device("mock:") as device:
        program = compile_touch(surface, preset.material, device)
    return {**engine_files(), "picture.jpg": picture.read_bytes(), "touch.hxp": program}


def on_config(config: Any) -> Any:
    """Put the API into the navigation."""
    for section in config.nav:
        for entry in section.get("Reference", []):
            if entry.get("API") == "reference":
                entry["API"] = [f"reference/{package}.md" for package in PACKAGES]
    return config


def on_page_markdown(markdown: str, page: Any, **about: Any) -> str:
    """Mark figures of older code; let links out of docs/ lead to their pages, or name the file."""
    markdown = figures.filled(markdown, figures.read(), marked=True)
    for name, path in OUTSIDE.items():
        markdown = re.sub(rf"\]\((?:\.\./)?{re.escape(path)}", f"]({name}", markdown)
    folder = (ROOT / "docs" / page.file.src_uri).parent

    def named(link: re.Match[str]) -> str:
        path = (folder / link["to"]).resolve()
        if path.is_relative_to(ROOT / "docs") or not path.exists():
            return link[0]
        file = f"`{path.relative_to(ROOT)}`"
        return link["words"] if file in link["words"] else f"{link['words']} ({file})"

    markdown = re.sub(r"\[(?P<words>[^]\[]+)\]\((?P<to>\.\./[^)#]+)\)", named, markdown)
    return re.sub(r"\]\((?:\.\./)*docs/", "](", markdown)


def on_post_build(config: Any) -> None:
    """Let the search know a method by its class: `Texture.from_image`, not `from_image`."""
    path = Path(config.site_dir) / "search" / "search_index.json"
    index = json.loads(path.read_text("utf-8"))
    for section in index["docs"]:
        page, _, anchor = section["location"].partition("#")
        if page.startswith("reference/") and (name := re.search(r"[A-Z]\w*\.\w+$", anchor)):
            section["title"] = name[0]
            section["boost"] = 1.5  # before guides that have one of the two words
    path.write_text(json.dumps(index, ensure_ascii=False), "utf-8")
