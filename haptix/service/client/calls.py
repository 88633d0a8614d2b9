"""What a session can be asked, with and without ``await``.

Made by scripts/client_calls.py from the description of the session; do not edit.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from pydantic import BaseModel

from haptix.service.protocol import messages as m

Document = BaseModel | Mapping[str, object]
"""A material, a layout or a change: an object of its class, or its document."""


def given(**fields: object) -> dict[str, object]:
    """Fields that are not None."""
    return {name: value for name, value in fields.items() if value is not None}


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
            What it holds.
        """

    async def acquire(self, takeover: bool = False) -> m.Lease:
        """Ask for the lease on the output; with `takeover` also from who holds it."""
        reply: m.Lease = await self.ask("acquire", takeover=takeover)
        return reply

    async def arm(self) -> m.OutputMessage:
        """Let touches be felt."""
        reply: m.OutputMessage = await self.ask("arm")
        return reply

    async def cancel(self, effect_id: int) -> m.Done:
        """End an effect by the number that `playing` gave."""
        reply: m.Done = await self.ask("cancel", effect_id=effect_id)
        return reply

    async def disarm(self) -> m.OutputMessage:
        """End at 0 V and keep the lease."""
        reply: m.OutputMessage = await self.ask("disarm")
        return reply

    async def geometry(
        self,
        px_per_mm: float,
        origin_mm: tuple[float, float] = (0.0, 0.0),
        rotation_deg: float = 0.0,
    ) -> m.Done:
        """Say how pixels become mm: ``origin_mm + turn(rotation_deg) (px / px_per_mm)``.

        Parameters
        ----------
        px_per_mm : float
        origin_mm : tuple[float, float]
        rotation_deg : float
        """
        reply: m.Done = await self.ask(
            "geometry", px_per_mm=px_per_mm, origin_mm=origin_mm, rotation_deg=rotation_deg
        )
        return reply

    async def intensity(self, value: float) -> m.OutputMessage:
        """Set the share of friction that is asked for, 0 to 1."""
        reply: m.OutputMessage = await self.ask("intensity", value=value)
        return reply

    async def inventory(self) -> m.Inventory:
        """Ask which devices and profiles there are."""
        reply: m.Inventory = await self.ask("inventory")
        return reply

    async def layout_change(self, ops: Sequence[Document]) -> m.LayoutReply:
        """Change the layout of this session: all of `ops`, or nothing."""
        reply: m.LayoutReply = await self.ask("layout_change", ops=ops)
        return reply

    async def layout_set(self, document: Document) -> m.LayoutReply:
        """Replace the layout of this session by a document."""
        reply: m.LayoutReply = await self.ask("layout_set", document=document)
        return reply

    async def mute(self, on: bool) -> m.OutputMessage:
        """Hold 0 V while time runs, until the lease ends."""
        reply: m.OutputMessage = await self.ask("mute", on=on)
        return reply

    async def pause(self, on: bool) -> m.OutputMessage:
        """Hold 0 V while time stands, until the lease ends."""
        reply: m.OutputMessage = await self.ask("pause", on=on)
        return reply

    async def play(self, effect: Document) -> m.PlayingMessage:
        """Play an effect that ends, such as a transient; `effect_ended` tells its end."""
        reply: m.PlayingMessage = await self.ask("play", effect=effect)
        return reply

    async def release(self) -> m.Done:
        """Give the lease back; 0 V first."""
        reply: m.Done = await self.ask("release")
        return reply

    async def sense(self, on: bool) -> m.OutputMessage:
        """Learn the finger by the current that it draws, from the next `arm` on."""
        reply: m.OutputMessage = await self.ask("sense", on=on)
        return reply

    async def stop(self) -> m.Done:
        """End at 0 V, whoever holds the output."""
        reply: m.Done = await self.ask("stop")
        return reply

    async def subscribe(
        self, streams: Mapping[Literal["stats", "friction", "felt"], float]
    ) -> m.Subscribed:
        """Ask for streams, each with its highest rate in hertz; 0 ends one."""
        reply: m.Subscribed = await self.ask("subscribe", streams=streams)
        return reply

    async def watch(self, job: str) -> m.JobMessage:
        """Ask how far a job is, and be told of its changes until it ends."""
        reply: m.JobMessage = await self.ask("watch", job=job)
        return reply


class ClientLayout:
    """The layout of a session: what is felt where; `layout` of a client.

    Parameters
    ----------
    calls : AsyncCalls
        The client.
    """

    def __init__(self, calls: AsyncCalls) -> None:
        self._calls, self._count = calls, 0

    async def add(
        self,
        material: Document,
        *,
        name: str = "",
        x_mm: float | None = None,
        y_mm: float | None = None,
        rotation_deg: float | None = None,
        width_mm: float | None = None,
        height_mm: float | None = None,
        shape: Literal["rectangle", "ellipse"] | Sequence[tuple[float, float]] | None = None,
        scale: float | None = None,
        z: float | None = None,
        blend: Literal["over", "add", "multiply", "max", "min"] | None = None,
        opacity: float | None = None,
        priority: int | None = None,
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
        change = given(
            op="add",
            name=name,
            material=material,
            x_mm=x_mm,
            y_mm=y_mm,
            rotation_deg=rotation_deg,
            width_mm=width_mm,
            height_mm=height_mm,
            shape=shape,
            scale=scale,
            z=z,
            blend=blend,
            opacity=opacity,
            priority=priority,
        )
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
        The client.
    name : str
        Its name.
    """

    def __init__(self, calls: AsyncCalls, name: str) -> None:
        self._calls, self.name = calls, name

    async def change(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        rotation_deg: float | None = None,
        width_mm: float | None = None,
        height_mm: float | None = None,
        shape: Literal["rectangle", "ellipse"] | Sequence[tuple[float, float]] | None = None,
        scale: float | None = None,
        z: float | None = None,
        blend: Literal["over", "add", "multiply", "max", "min"] | None = None,
        opacity: float | None = None,
        priority: int | None = None,
        material: Document | None = None,
    ) -> m.LayoutReply:
        """Change what is given of a region, in a cross-fade."""
        change = given(
            op="change",
            name=self.name,
            x_mm=x_mm,
            y_mm=y_mm,
            rotation_deg=rotation_deg,
            width_mm=width_mm,
            height_mm=height_mm,
            shape=shape,
            scale=scale,
            z=z,
            blend=blend,
            opacity=opacity,
            priority=priority,
            material=material,
        )
        return await self._calls.layout_change([change])

    async def move(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        rotation_deg: float | None = None,
        over_s: float = 0.02,
    ) -> m.LayoutReply:
        """Move a region within `over_s`; what is left out stays."""
        change = given(
            op="move",
            name=self.name,
            x_mm=x_mm,
            y_mm=y_mm,
            rotation_deg=rotation_deg,
            over_s=over_s,
        )
        return await self._calls.layout_change([change])

    async def remove(self) -> m.LayoutReply:
        """Remove a region; it fades out."""
        change = given(op="remove", name=self.name)
        return await self._calls.layout_change([change])

    async def set_value(self, value: float) -> m.LayoutReply:
        """Set the value of a control, such as a slider; it comes after all other changes."""
        change = given(op="value", name=self.name, value=value)
        return await self._calls.layout_change([change])


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
            What it holds.
        """

    def acquire(self, takeover: bool = False) -> m.Lease:
        """Ask for the lease on the output; with `takeover` also from who holds it."""
        reply: m.Lease = self.ask("acquire", takeover=takeover)
        return reply

    def arm(self) -> m.OutputMessage:
        """Let touches be felt."""
        reply: m.OutputMessage = self.ask("arm")
        return reply

    def cancel(self, effect_id: int) -> m.Done:
        """End an effect by the number that `playing` gave."""
        reply: m.Done = self.ask("cancel", effect_id=effect_id)
        return reply

    def disarm(self) -> m.OutputMessage:
        """End at 0 V and keep the lease."""
        reply: m.OutputMessage = self.ask("disarm")
        return reply

    def geometry(
        self,
        px_per_mm: float,
        origin_mm: tuple[float, float] = (0.0, 0.0),
        rotation_deg: float = 0.0,
    ) -> m.Done:
        """Say how pixels become mm: ``origin_mm + turn(rotation_deg) (px / px_per_mm)``.

        Parameters
        ----------
        px_per_mm : float
        origin_mm : tuple[float, float]
        rotation_deg : float
        """
        reply: m.Done = self.ask(
            "geometry", px_per_mm=px_per_mm, origin_mm=origin_mm, rotation_deg=rotation_deg
        )
        return reply

    def intensity(self, value: float) -> m.OutputMessage:
        """Set the share of friction that is asked for, 0 to 1."""
        reply: m.OutputMessage = self.ask("intensity", value=value)
        return reply

    def inventory(self) -> m.Inventory:
        """Ask which devices and profiles there are."""
        reply: m.Inventory = self.ask("inventory")
        return reply

    def layout_change(self, ops: Sequence[Document]) -> m.LayoutReply:
        """Change the layout of this session: all of `ops`, or nothing."""
        reply: m.LayoutReply = self.ask("layout_change", ops=ops)
        return reply

    def layout_set(self, document: Document) -> m.LayoutReply:
        """Replace the layout of this session by a document."""
        reply: m.LayoutReply = self.ask("layout_set", document=document)
        return reply

    def mute(self, on: bool) -> m.OutputMessage:
        """Hold 0 V while time runs, until the lease ends."""
        reply: m.OutputMessage = self.ask("mute", on=on)
        return reply

    def pause(self, on: bool) -> m.OutputMessage:
        """Hold 0 V while time stands, until the lease ends."""
        reply: m.OutputMessage = self.ask("pause", on=on)
        return reply

    def play(self, effect: Document) -> m.PlayingMessage:
        """Play an effect that ends, such as a transient; `effect_ended` tells its end."""
        reply: m.PlayingMessage = self.ask("play", effect=effect)
        return reply

    def release(self) -> m.Done:
        """Give the lease back; 0 V first."""
        reply: m.Done = self.ask("release")
        return reply

    def sense(self, on: bool) -> m.OutputMessage:
        """Learn the finger by the current that it draws, from the next `arm` on."""
        reply: m.OutputMessage = self.ask("sense", on=on)
        return reply

    def stop(self) -> m.Done:
        """End at 0 V, whoever holds the output."""
        reply: m.Done = self.ask("stop")
        return reply

    def subscribe(
        self, streams: Mapping[Literal["stats", "friction", "felt"], float]
    ) -> m.Subscribed:
        """Ask for streams, each with its highest rate in hertz; 0 ends one."""
        reply: m.Subscribed = self.ask("subscribe", streams=streams)
        return reply

    def watch(self, job: str) -> m.JobMessage:
        """Ask how far a job is, and be told of its changes until it ends."""
        reply: m.JobMessage = self.ask("watch", job=job)
        return reply


class PlainLayout:
    """The layout of a session: what is felt where; `layout` of a client.

    Parameters
    ----------
    calls : PlainCalls
        The client.
    """

    def __init__(self, calls: PlainCalls) -> None:
        self._calls, self._count = calls, 0

    def add(
        self,
        material: Document,
        *,
        name: str = "",
        x_mm: float | None = None,
        y_mm: float | None = None,
        rotation_deg: float | None = None,
        width_mm: float | None = None,
        height_mm: float | None = None,
        shape: Literal["rectangle", "ellipse"] | Sequence[tuple[float, float]] | None = None,
        scale: float | None = None,
        z: float | None = None,
        blend: Literal["over", "add", "multiply", "max", "min"] | None = None,
        opacity: float | None = None,
        priority: int | None = None,
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
        change = given(
            op="add",
            name=name,
            material=material,
            x_mm=x_mm,
            y_mm=y_mm,
            rotation_deg=rotation_deg,
            width_mm=width_mm,
            height_mm=height_mm,
            shape=shape,
            scale=scale,
            z=z,
            blend=blend,
            opacity=opacity,
            priority=priority,
        )
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
        The client.
    name : str
        Its name.
    """

    def __init__(self, calls: PlainCalls, name: str) -> None:
        self._calls, self.name = calls, name

    def change(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        rotation_deg: float | None = None,
        width_mm: float | None = None,
        height_mm: float | None = None,
        shape: Literal["rectangle", "ellipse"] | Sequence[tuple[float, float]] | None = None,
        scale: float | None = None,
        z: float | None = None,
        blend: Literal["over", "add", "multiply", "max", "min"] | None = None,
        opacity: float | None = None,
        priority: int | None = None,
        material: Document | None = None,
    ) -> m.LayoutReply:
        """Change what is given of a region, in a cross-fade."""
        change = given(
            op="change",
            name=self.name,
            x_mm=x_mm,
            y_mm=y_mm,
            rotation_deg=rotation_deg,
            width_mm=width_mm,
            height_mm=height_mm,
            shape=shape,
            scale=scale,
            z=z,
            blend=blend,
            opacity=opacity,
            priority=priority,
            material=material,
        )
        return self._calls.layout_change([change])

    def move(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        rotation_deg: float | None = None,
        over_s: float = 0.02,
    ) -> m.LayoutReply:
        """Move a region within `over_s`; what is left out stays."""
        change = given(
            op="move",
            name=self.name,
            x_mm=x_mm,
            y_mm=y_mm,
            rotation_deg=rotation_deg,
            over_s=over_s,
        )
        return self._calls.layout_change([change])

    def remove(self) -> m.LayoutReply:
        """Remove a region; it fades out."""
        change = given(op="remove", name=self.name)
        return self._calls.layout_change([change])

    def set_value(self, value: float) -> m.LayoutReply:
        """Set the value of a control, such as a slider; it comes after all other changes."""
        change = given(op="value", name=self.name, value=value)
        return self._calls.layout_change([change])
