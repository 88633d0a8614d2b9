"""The layout of a session: its regions, checked and put on the screen."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptix.base.errors import HaptixError, InputError
from haptix.feel.materials.memory import MapMemory

if TYPE_CHECKING:
    from haptix.feel.layout import LayoutRegion


MOST_REGIONS = 256
MOST_MAP_BYTES, MOST_SESSION_MAP_BYTES = 2 * 2**30, 2**30
"""Memory of the maps of all sessions' materials, and of one session's."""


class SessionLayout:
    """Regions by their names.

    Parameters
    ----------
    assets : Path
        Folder of the files that apps have sent; documents read nothing else.
    memory : MapMemory, optional
        Budget of all sessions, in which this one has a share.
    """

    def __init__(self, assets: Path, memory: MapMemory | None = None) -> None:
        from haptix.feel.layout import Layout

        self._memory = MapMemory(MOST_SESSION_MAP_BYTES, "this session's materials", memory)

        self._assets = assets
        self.layout = Layout()
        self.regions: dict[str, LayoutRegion] = {}
        self.revision = 0

    def set(self, document: Mapping[str, Any]) -> None:
        """Replace all regions by those of a document, or change nothing.

        Raises `InputError` naming the region and its error.
        """
        with self._memory.counts(), self.layout.change():
            regions = self.regions
            self.regions = {}
            try:
                for region in regions.values():
                    region.remove()
                for number, region in enumerate(document["regions"]):
                    self._do(f"/document/regions/{number}", {"op": "add", **region})
            except BaseException:
                self.regions = regions
                raise
        self.revision += 1

    def change(self, ops: Iterable[Mapping[str, Any]]) -> None:
        """Make all of the changes, or none.

        Raises `InputError` naming the change and its error.
        """
        regions = dict(self.regions)
        values: list[tuple[LayoutRegion, float]] = []
        try:
            with self._memory.counts(), self.layout.change():
                for number, op in enumerate(ops):
                    if op["op"] == "value":
                        values.append((self._control(f"/ops/{number}", op["name"]), op["value"]))
                    else:
                        self._do(f"/ops/{number}", op)
                for region, value in values:  # they cannot be taken back, and fail no more
                    region.set_value(value)
        except BaseException:
            self.regions = regions
            raise
        self.revision += 1

    def _do(self, path: str, op: Mapping[str, Any]) -> None:
        fields = dict(op)
        kind, name = fields.pop("op"), fields.pop("name")
        try:
            if kind == "add":
                self._add(name, fields)
                return
            region = self._named(name)
            if kind == "move":
                region.move(**fields)
            elif kind == "change":
                region.change(**self._read(fields))
            else:
                region.remove()
                del self.regions[name]
        except HaptixError as error:
            raise RegionError(path, f"{name}: {error}") from None

    def _control(self, path: str, name: str) -> LayoutRegion:
        """Return a region that has a value."""
        try:
            region = self._named(name)
            _ = region.value
        except HaptixError as error:
            raise RegionError(path, f"{name}: {error}") from None
        return region

    def _named(self, name: str) -> LayoutRegion:
        if name not in self.regions:
            names = ", ".join(map(repr, [*self.regions][-5:])) or "none, as after a new start"
            raise InputError(f"expected the name of a region (there are {names}), got {name!r:.80}")
        return self.regions[name]

    def _add(self, name: str, fields: dict[str, Any]) -> None:
        if name in self.regions:
            raise InputError("expected a name that no region has; change or remove that one")
        if len(self.regions) >= MOST_REGIONS:
            raise InputError(f"expected at most {MOST_REGIONS} regions")
        self.regions[name] = self.layout.add(**self._read(fields))

    def _read(self, fields: dict[str, Any]) -> dict[str, Any]:
        from haptix.base.kinds import in_folder
        from haptix.feel.materials import material_of

        if "material" in fields:
            with in_folder(self._assets, is_sealed=True):
                material = fields["material"] = material_of(fields["material"])
                _ = material.evaluator  # reads its files
        return fields


class RegionError(InputError):
    """A region that cannot be; `path` points to it in the message."""

    def __init__(self, path: str, sentence: str) -> None:
        super().__init__(sentence)
        self.path = path
