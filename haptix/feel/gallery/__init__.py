"""The gallery: presets of materials by physical family, each a document that can be changed.

A preset is a JSON file of this folder: a title, a family, a sentence of help, the size of its
region and the material. Photographs and heights that presets name by their hash lie in ``assets``.
Reading a preset needs no physics, so that the service's front can hand them out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptix.base.errors import InputError
from haptix.base.files import read_json

if TYPE_CHECKING:
    from haptix.feel.materials import Material

FOLDER = Path(__file__).parent
ASSETS = FOLDER / "assets"
"""Files that presets name by ``sha256:``; each is called by its hash."""

FAMILIES = (
    "ribs", "weaves", "grains", "photographs", "edges", "widgets", "motion", "behaviour",
)  # fmt: skip
"""In the order in which they are shown."""


@dataclass(frozen=True)
class Preset:
    """A material with the facts by which a person chooses it.

    Attributes
    ----------
    name : str
        Name in addresses and commands.
    title, family, help : str
        For people; the family is one of `FAMILIES`.
    width_mm, height_mm : float
        Size of the region that shows it well.
    reachable : float
        Share of the places of its `picture` whose friction a screen can give.
    document : dict
        The material's document.
    """

    name: str
    title: str
    family: str
    help: str
    width_mm: float
    height_mm: float
    reachable: float
    document: dict[str, Any]

    @property
    def material(self) -> Material:
        """The material itself."""
        # Here, since materials load torch.
        from haptix.base.kinds import in_folder
        from haptix.feel.materials import material_of

        with in_folder(FOLDER):
            return material_of(self.document)


@cache
def presets() -> tuple[Preset, ...]:
    """All presets, by family.

    Examples
    --------
    >>> "corduroy" in [preset.name for preset in presets()]
    True
    """
    unsorted = [_read(path) for path in sorted(FOLDER.glob("*.json"))]
    return tuple(sorted(unsorted, key=lambda preset: (FAMILIES.index(preset.family), preset.title)))


def preset(name: str) -> Preset:
    """Return the preset of a name.

    Raises `InputError` if there is none.

    Examples
    --------
    >>> preset("corduroy").document
    {'kind': 'grating', 'period_mm': 2.5}
    """
    for preset in presets():
        if preset.name == name:
            return preset
    names = ", ".join(preset.name for preset in presets())
    raise InputError(f"gallery: expected one of {names}, got {name!r:.60}")


def _read(path: Path) -> Preset:
    fields = read_json(path)
    del fields["schema_version"]
    return Preset(name=path.stem, document=fields.pop("material"), **fields)


def load(path: str | Path) -> Material:
    """Read a material from a file, or the preset that ``gallery:NAME`` names.

    Raises `InputError` or `FileFormatError` if there is no such preset, or the file cannot be read,
    see `haptix.feel.materials.load`.

    Examples
    --------
    >>> load("gallery:corduroy").kind
    'grating'
    """
    from haptix.feel.materials import load as from_file

    name = str(path).removeprefix("gallery:")
    return from_file(path) if name == str(path) else preset(name).material
