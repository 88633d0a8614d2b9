"""What the engine was told and a new one does not know: layouts, intensity, mute and pause."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any


class KeptLayout:
    """The layout of one session as a document: the last one, and what was changed since."""

    def __init__(self) -> None:
        self.revision = 0
        self._regions: dict[str, dict[str, Any]] = {}
        self._values: dict[str, float] = {}

    def set(self, document: Mapping[str, Any]) -> None:
        """Take a document that the engine has accepted."""
        self._values = {}
        self._regions = {one["name"]: dict(one) for one in document["regions"]}
        self.revision += 1

    def change(self, ops: Iterable[Mapping[str, Any]]) -> None:
        """Take changes that the engine has accepted."""
        for op in ops:
            fields = dict(op)
            kind, name = fields.pop("op"), fields["name"]
            if kind == "remove":
                del self._regions[name]
                self._values.pop(name, None)
            elif kind == "value":
                self._values[name] = fields["value"]
            else:
                fields.pop("over_s", None)
                if "material" in fields:
                    self._values.pop(name, None)
                self._regions[name] = {**self._regions.get(name, {}), **fields}
        self.revision += 1

    @property
    def again(self) -> dict[str, Any]:
        """What makes the same layout: fields of `layout_again`."""
        return {
            "document": {"regions": list(self._regions.values())},
            "values": self._values,
            "revision": self.revision,
        }


class Told:
    """Notes what one engine accepts, and says it to the next one; nothing of it arms."""

    def __init__(self) -> None:
        self._layouts: dict[int, KeptLayout] = {}  # by session
        self._settings: dict[str, dict[str, Any]] = {}

    def note(self, do: str, fields: Mapping[str, Any]) -> None:
        """Take note of what was accepted."""
        session = fields.get("session", 0)
        if do == "layout_set":
            self._layouts.setdefault(session, KeptLayout()).set(fields["document"])
        elif do == "layout_change":
            self._layouts.setdefault(session, KeptLayout()).change(fields["ops"])
        elif do == "forget":
            self._layouts.pop(session, None)
        elif do in ("intensity", "mute", "pause"):
            self._settings[do] = dict(fields)

    def layouts(self) -> list[dict[str, Any]]:
        """Return the layouts of all sessions, as fields of `layout_again`."""
        return [{"session": session, **one.again} for session, one in self._layouts.items()]

    def again(self) -> list[tuple[str, dict[str, Any]]]:
        """Return what a new engine is to be told."""
        return [*(("layout_again", one) for one in self.layouts()), *self._settings.items()]
