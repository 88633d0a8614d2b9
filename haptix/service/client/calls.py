"""The requests of a session, with and without ``await``.

Made by scripts/client_calls.py from the description of the session; do not edit.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict, Unpack

from pydantic import BaseModel

from haptix.service.protocol import messages as m

# mypy: disable-error-code="no-any-return"

Document = BaseModel | Mapping[str, object]
"""A material, a layout or a change: an object of its class, or its document."""


def given(**fields: object) -> dict[str, object]:
    """Fields that are not None."""
    return {name: value for name, value in fields.items() if value is not None}


class MoveRegionFields(TypedDict, total=False):
    """Fields of `move`; `haptix.feel.layout.region.RegionFields` describes them."""

    x_mm: float | None
    y_mm: float | None
    rotation_deg: float | None
    over_s: float


class AddRegionFields(TypedDict, total=False):
    """Fields of `add`; `haptix.feel.layout.region.RegionFields` describes them."""

    x_mm: float | None
    y_mm: float | None
    rotation_deg: float | None
    width_mm: float | None
    height_mm: float | None
    shape: Literal["rectangle", "ellipse"] | Sequence[tuple[float, float]] | None
    scale: float | None
    z: float | None
    blend: Literal["over", "add", "multiply", "max", "min"] | None
    opacity: float | None
    priority: int | None
    group: str | None


class ChangeRegionFields(AddRegionFields, total=False):
    """Fields of `change`; `haptix.feel.layout.region.RegionFields` describes them."""

    material: Document | None


class AsyncCalls(ABC):
    """The messages of a session that are answered; each raises `Refused` or `Lost`."""

    @abstractmethod
    async def ask(self, kind: str, **fields: Any) -> Any:
        """Send a message and return its answer.

        Parameters
        ----------
        kind : str
            Its type.
        **fields
            Its content.
        """

    async def acquire(self, takeover: bool = False) -> m.Lease:
        """Ask for the lease on the output; with `takeover` also from who holds it."""
        return await self.ask("acquire", takeover=takeover)

    async def arm(self) -> m.OutputMessage:
        """Let touches be felt."""
        return await self.ask("arm")

    async def cancel(self, effect_id: int) -> m.Done:
        """End an effect by the number that `playing` gave."""
        return await self.ask("cancel", effect_id=effect_id)

    async def geometry(
        self,
        px_per_mm: float,
        origin_mm: tuple[float, float] = (0.0, 0.0),
        rotation_deg: float = 0.0,
    ) -> m.Done:
        """Map pixels to mm: ``origin_mm + turn(rotation_deg) (px / px_per_mm)``.

        Parameters
        ----------
        px_per_mm : float
        origin_mm : tuple[float, float]
        rotation_deg : float
        """
        return await self.ask(
            "geometry", px_per_mm=px_per_mm, origin_mm=origin_mm, rotation_deg=rotation_deg
        )

    async def intensity(self, value: float) -> m.OutputMessage:
        """Set the share of friction that is asked for, 0 to 1."""
        return await self.ask("intensity", value=value)

    async def inventory(self) -> m.Inventory:
        """Ask which devices and profiles there are."""
        return await self.ask("inventory")

    async def layout_change(self, ops: Sequence[Document]) -> m.LayoutReply:
        """Change the layout of this session: all of `ops`, or nothing."""
        return await self.ask("layout_change", ops=ops)

    async def layout_set(self, document: Document) -> m.LayoutReply:
        """Replace the layout of this session by a document."""
        return await self.ask("layout_set", document=document)

    async def mute(self, on: bool = True) -> m.OutputMessage:
        """Hold 0 V while time runs, until the lease ends."""
        return await self.ask("mute", on=on)

    async def pause(self, on: bool = True) -> m.OutputMessage:
        """Hold 0 V while time stands, until the lease ends."""
        return await self.ask("pause", on=on)

    async def play(self, effect: Document) -> m.PlayingMessage:
        """Play an effect that ends, such as a transient; `effect_ended` reports its end."""
        return await self.ask("play", effect=effect)

    async def release(self) -> m.Done:
        """Give the lease back; 0 V first."""
        return await self.ask("release")

    async def sense(self, on: bool = True) -> m.OutputMessage:
        """Learn the finger by the current that it draws, from the next `arm` on."""
        return await self.ask("sense", on=on)

    async def stop(self) -> m.Done:
        """End at 0 V, whoever holds the output; the holder keeps the lease."""
        return await self.ask("stop")

    async def subscribe(
        self, streams: Mapping[Literal["stats", "friction", "felt"], float]
    ) -> m.Subscribed:
        """Ask for streams, each with its highest rate in hertz; 0 ends one."""
        return await self.ask("subscribe", streams=streams)

    async def watch(self, job: str) -> m.JobMessage:
        """Request the progress of a job, and its changes until it ends."""
        return await self.ask("watch", job=job)


class ClientLayout:
    """The layout of a session: its materials by place; `layout` of a client.

    Parameters
    ----------
    calls : AsyncCalls
        The client.
    """

    def __init__(self, calls: AsyncCalls) -> None:
        self._calls, self._count = calls, 0

    async def add(
        self, material: Document, *, name: str = "", **fields: Unpack[AddRegionFields]
    ) -> ClientRegion:
        """Add a region.

        Parameters
        ----------
        material : Material or dict
            One of `haptix.feel.materials` that names no files, or its document.
        name : str, optional
            For `contact` events; made where none is given.
        **fields
            Those of `haptix.feel.layout.region.RegionFields`.

        Raises
        ------
        Refused
            If the service refuses it.
        """
        self._count += 1
        name = name or f"region {self._count}"
        change = given(op="add", name=name, material=material, **fields)
        await self._calls.layout_change([change])
        return ClientRegion(self._calls, name)

    async def clear(self) -> m.LayoutReply:
        """Remove all regions."""
        return await self._calls.layout_set({"regions": []})


class ClientRegion:
    """A region of a session's layout, by its name; each call is one change.

    Parameters
    ----------
    calls : AsyncCalls
        The client, `session` from then on.
    name : str
        Its name.
    """

    def __init__(self, calls: AsyncCalls, name: str) -> None:
        self.session: Any = calls
        self.name = name

    async def change(self, **fields: Unpack[ChangeRegionFields]) -> m.LayoutReply:
        """Change the given fields of a region, in a cross-fade."""
        change = given(op="change", name=self.name, **fields)
        return await self.session.layout_change([change])

    async def move(self, **fields: Unpack[MoveRegionFields]) -> m.LayoutReply:
        """Move a region within `over_s`; fields that are left out stay."""
        change = given(op="move", name=self.name, **fields)
        return await self.session.layout_change([change])

    async def remove(self) -> m.LayoutReply:
        """Remove a region; it fades out."""
        change = given(op="remove", name=self.name)
        return await self.session.layout_change([change])

    async def set_value(self, value: float) -> m.LayoutReply:
        """Set the value of a control, such as a slider; it comes after all other changes."""
        change = given(op="value", name=self.name, value=value)
        return await self.session.layout_change([change])


class PlainCalls(ABC):
    """The messages of a session that are answered; each raises `Refused` or `Lost`."""

    @abstractmethod
    def ask(self, kind: str, **fields: Any) -> Any:
        """Send a message and return its answer.

        Parameters
        ----------
        kind : str
            Its type.
        **fields
            Its content.
        """

    def acquire(self, takeover: bool = False) -> m.Lease:
        """Ask for the lease on the output; with `takeover` also from who holds it."""
        return self.ask("acquire", takeover=takeover)

    def arm(self) -> m.OutputMessage:
        """Let touches be felt."""
        return self.ask("arm")

    def cancel(self, effect_id: int) -> m.Done:
        """End an effect by the number that `playing` gave."""
        return self.ask("cancel", effect_id=effect_id)

    def geometry(
        self,
        px_per_mm: float,
        origin_mm: tuple[float, float] = (0.0, 0.0),
        rotation_deg: float = 0.0,
    ) -> m.Done:
        """Map pixels to mm: ``origin_mm + turn(rotation_deg) (px / px_per_mm)``.

        Parameters
        ----------
        px_per_mm : float
        origin_mm : tuple[float, float]
        rotation_deg : float
        """
        return self.ask(
            "geometry", px_per_mm=px_per_mm, origin_mm=origin_mm, rotation_deg=rotation_deg
        )

    def intensity(self, value: float) -> m.OutputMessage:
        """Set the share of friction that is asked for, 0 to 1."""
        return self.ask("intensity", value=value)

    def inventory(self) -> m.Inventory:
        """Ask which devices and profiles there are."""
        return self.ask("inventory")

    def layout_change(self, ops: Sequence[Document]) -> m.LayoutReply:
        """Change the layout of this session: all of `ops`, or nothing."""
        return self.ask("layout_change", ops=ops)

    def layout_set(self, document: Document) -> m.LayoutReply:
        """Replace the layout of this session by a document."""
        return self.ask("layout_set", document=document)

    def mute(self, on: bool = True) -> m.OutputMessage:
        """Hold 0 V while time runs, until the lease ends."""
        return self.ask("mute", on=on)

    def pause(self, on: bool = True) -> m.OutputMessage:
        """Hold 0 V while time stands, until the lease ends."""
        return self.ask("pause", on=on)

    def play(self, effect: Document) -> m.PlayingMessage:
        """Play an effect that ends, such as a transient; `effect_ended` reports its end."""
        return self.ask("play", effect=effect)

    def release(self) -> m.Done:
        """Give the lease back; 0 V first."""
        return self.ask("release")

    def sense(self, on: bool = True) -> m.OutputMessage:
        """Learn the finger by the current that it draws, from the next `arm` on."""
        return self.ask("sense", on=on)

    def stop(self) -> m.Done:
        """End at 0 V, whoever holds the output; the holder keeps the lease."""
        return self.ask("stop")

    def subscribe(
        self, streams: Mapping[Literal["stats", "friction", "felt"], float]
    ) -> m.Subscribed:
        """Ask for streams, each with its highest rate in hertz; 0 ends one."""
        return self.ask("subscribe", streams=streams)

    def watch(self, job: str) -> m.JobMessage:
        """Request the progress of a job, and its changes until it ends."""
        return self.ask("watch", job=job)


class PlainLayout:
    """The layout of a session: its materials by place; `layout` of a client.

    Parameters
    ----------
    calls : PlainCalls
        The client.
    """

    def __init__(self, calls: PlainCalls) -> None:
        self._calls, self._count = calls, 0

    def add(
        self, material: Document, *, name: str = "", **fields: Unpack[AddRegionFields]
    ) -> PlainRegion:
        """Add a region.

        Parameters
        ----------
        material : Material or dict
            One of `haptix.feel.materials` that names no files, or its document.
        name : str, optional
            For `contact` events; made where none is given.
        **fields
            Those of `haptix.feel.layout.region.RegionFields`.

        Raises
        ------
        Refused
            If the service refuses it.
        """
        self._count += 1
        name = name or f"region {self._count}"
        change = given(op="add", name=name, material=material, **fields)
        self._calls.layout_change([change])
        return PlainRegion(self._calls, name)

    def clear(self) -> m.LayoutReply:
        """Remove all regions."""
        return self._calls.layout_set({"regions": []})


class PlainRegion:
    """A region of a session's layout, by its name; each call is one change.

    Parameters
    ----------
    calls : PlainCalls
        The client, `session` from then on.
    name : str
        Its name.
    """

    def __init__(self, calls: PlainCalls, name: str) -> None:
        self.session: Any = calls
        self.name = name

    def change(self, **fields: Unpack[ChangeRegionFields]) -> m.LayoutReply:
        """Change the given fields of a region, in a cross-fade."""
        change = given(op="change", name=self.name, **fields)
        return self.session.layout_change([change])

    def move(self, **fields: Unpack[MoveRegionFields]) -> m.LayoutReply:
        """Move a region within `over_s`; fields that are left out stay."""
        change = given(op="move", name=self.name, **fields)
        return self.session.layout_change([change])

    def remove(self) -> m.LayoutReply:
        """Remove a region; it fades out."""
        change = given(op="remove", name=self.name)
        return self.session.layout_change([change])

    def set_value(self, value: float) -> m.LayoutReply:
        """Set the value of a control, such as a slider; it comes after all other changes."""
        change = given(op="value", name=self.name, value=value)
        return self.session.layout_change([change])
