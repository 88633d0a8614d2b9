"""The layout of a session by calls, for code that writes no JSON."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from haptix.service import messages as m

Change = Callable[..., Awaitable[m.LayoutReply]]


class ClientRegion:
    """A region of a session's layout, by its name; each call is one change."""

    def __init__(self, change: Change, name: str) -> None:
        self._change, self.name = change, name

    async def move(self, **fields: Any) -> m.LayoutReply:
        """Move to a `haptix.region.Place`, within `over_s`; what is left out stays."""
        return await self._change({"op": "move", "name": self.name, **fields})

    async def change(self, **fields: Any) -> m.LayoutReply:
        """Change what `ClientLayout.add` takes, in a cross-fade."""
        return await self._change({"op": "change", "name": self.name, **_plain(fields)})

    async def set_value(self, value: float) -> m.LayoutReply:
        """Set the value of a control, such as a slider, 0 to 1."""
        return await self._change({"op": "value", "name": self.name, "value": value})

    async def remove(self) -> m.LayoutReply:
        """Take it off; it fades out."""
        return await self._change({"op": "remove", "name": self.name})


class ClientLayout:
    """The layout of a session; ``h.layout`` of a client.

    Parameters
    ----------
    change : callable
        ``layout_change`` of the client.
    """

    def __init__(self, change: Change) -> None:
        self._change, self._count = change, 0

    async def add(self, material: Any, *, name: str = "", **fields: Any) -> ClientRegion:
        """Add a region.

        Parameters
        ----------
        material : dict or Material
            Its document, or one of `haptix.materials` that names no files.
        name : str, optional
            For `contact` events; made where none is given.
        **fields
            Those of `haptix.region.RegionFields`.

        Raises
        ------
        Refused
            If the service refuses it.
        """
        self._count += 1
        name = name or f"region {self._count}"
        fields = _plain({"material": material, **fields})
        await self._change({"op": "add", "name": name, **fields})
        return ClientRegion(self._change, name)


def _plain(fields: dict[str, Any]) -> dict[str, Any]:
    material: Any = fields.get("material")
    if hasattr(material, "model_dump"):
        return {**fields, "material": material.model_dump(mode="json", exclude_none=True)}
    return fields
