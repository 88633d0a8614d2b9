"""Layouts that people keep, and drafts of what they have not kept yet, over REST.

A layout is a folder of its versions, `NAME/REVISION.json`: a write adds one and replaces none, an
empty one says that the layout was removed. A write carries, as `If-Match`, the revision that it was
made from; without one it makes a new layout. So nobody overwrites what he has not seen.
"""

from __future__ import annotations

import json
import shutil
import threading
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from fastapi import APIRouter, Header, Response
from fastapi import Path as PathParameter
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from haptix.fields import JsonObject
from haptix.files import write_whole
from haptix.service import messages as m
from haptix.service.messages import Problem

MOST_LAYOUTS, MOST_VERSIONS = 1000, 50
MOST_DRAFTS, MOST_REMOVED = 100, 100
_NAME = r"^[A-Za-z0-9][A-Za-z0-9 _.-]{0,79}$"
Name = Annotated[str, PathParameter(pattern=_NAME)]
IfMatch = Annotated[str | None, Header()]


class Version(BaseModel):
    """A version of a kept layout, or a draft: its revision, and when it was written."""

    name: str
    revision: int
    unix_s: float


class Draft(BaseModel):
    """A layout that is being edited, and what it was made from."""

    model_config = ConfigDict(extra="forbid")
    name: Annotated[str, Field(pattern=_NAME)]
    made_from: Annotated[int, Field(ge=1)] | None = None
    """Revision of the kept layout; none where none is kept."""
    document: JsonObject
    """As the page has it: a draft that is wrong is kept, too."""


class Rename(BaseModel):
    """What `POST /v1/layouts/{name}/rename` takes."""

    model_config = ConfigDict(extra="forbid")
    to: Annotated[str, Field(pattern=_NAME)]


class _Kept(NamedTuple):
    revision: int
    path: Path


class KeptTexts:
    """Texts by name, each with its last versions; every write says what it was made from.

    Parameters
    ----------
    folder : Path
        Made if it does not exist. A file `NAME.json` in it becomes the newest version of its name.
    most_versions : int
        Older ones go.
    """

    def __init__(self, folder: Path, most_versions: int = MOST_VERSIONS) -> None:
        self._folder, self._most = folder, most_versions
        self._lock = threading.RLock()
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        for path in folder.glob("*.json"):
            if path.is_file():
                (folder / path.stem).mkdir(exist_ok=True)
                path.replace(self._next(path.stem))

    def names(self, are_removed: bool = False) -> list[str]:
        """Return the names that are kept, or those of which only history is."""
        with self._lock:
            names = sorted(path.name for path in self._folder.iterdir() if path.is_dir())
            return [
                name
                for name in names
                if self._all(name) and (self._now(name) is None) == are_removed
            ]

    def versions(self, name: str) -> list[Version]:
        """Return what can be read of a name, the newest first."""
        with self._lock:
            return [
                Version(name=name, revision=one.revision, unix_s=one.path.stat().st_mtime)
                for one in reversed(self._all(name))
                if one.path.stat().st_size
            ]

    def read(self, name: str, revision: int | None = None) -> tuple[str, int]:
        """Return a text and its revision: the newest, or that of a version."""
        with self._lock:
            kept = self._now(name)
            if revision is not None:
                kept = next((one for one in self._all(name) if one.revision == revision), None)
            if kept is None or not (text := kept.path.read_text()):
                what = f"no layout is called {name!r}"
                raise Problem("unknown", what if revision is None else f"{what}, {revision}")
            return text, kept.revision

    def write(self, name: str, text: str, made_from: str | None) -> int:
        """Add a version and return its revision; what is written twice is written once."""
        with self._lock:
            now = self._now(name)
            if now is not None and now.path.read_text() == text:
                return now.revision
            self._check(name, now, made_from)
            path = self._next(name)
            write_whole(path, text)
            for old in self._all(name)[: -self._most]:
                old.path.unlink()
            return int(path.stem)

    def remove(self, name: str, made_from: str | None) -> None:
        """Remove a layout; its versions stay, and the last one can be written again."""
        with self._lock:
            now = self._now(name)
            if now is None:
                raise Problem("unknown", f"no layout is called {name!r}")
            self._check(name, now, made_from)
            write_whole(self._next(name), "")
            removed = self.names(are_removed=True)
            removed.sort(key=lambda one: self._all(one)[-1].path.stat().st_mtime)
            for old in removed[:-MOST_REMOVED]:
                shutil.rmtree(self._folder / old)

    def rename(self, name: str, to: str, made_from: str | None) -> None:
        """Give a layout, with its versions, a name that no other one has."""
        with self._lock:
            now = self._now(name)
            if now is None:
                raise Problem("unknown", f"no layout is called {name!r}")
            self._check(name, now, made_from)
            if self._now(to) is not None:
                raise Problem("order", f"a layout is called {to!r} already; choose another name")
            if (self._folder / to).exists():  # a removed one: it stays, beside
                numbers = range(2, len(list(self._folder.iterdir())) + 3)
                free = (f"{to[:70]} {n}" for n in numbers)
                aside = next(one for one in free if not (self._folder / one).exists())
                (self._folder / to).rename(self._folder / aside)
            (self._folder / name).rename(self._folder / to)

    def _check(self, name: str, now: _Kept | None, made_from: str | None) -> None:
        """Raise `Problem` unless a write was made from what is kept."""
        if made_from is None and now is not None:
            why = f"{name!r} is kept already: read it first and send its ETag as If-Match, or keep "
            raise Problem("stale", f"{why}yours under another name")
        if made_from is not None and now is None:
            why = f"{name!r} was removed or renamed meanwhile; keep yours under another name"
            raise Problem("stale", why)
        if now is not None and made_from != _etag(now.revision):
            why = f"another page or app has kept {name!r} meanwhile (revision {now.revision}): read"
            raise Problem("stale", f"{why} that one, or keep yours under another name")

    def _all(self, name: str) -> list[_Kept]:
        """Return the versions of a name, the oldest first."""
        paths = (self._folder / name).glob("*.json")
        return sorted(_Kept(int(path.stem), path) for path in paths if path.stem.isdecimal())

    def _now(self, name: str) -> _Kept | None:
        """Return the newest version, or None where the layout is removed or was never there."""
        newest = self._all(name)[-1:]
        return newest[0] if newest and newest[0].path.stat().st_size else None

    def _next(self, name: str) -> Path:
        newest = self._all(name)[-1:]
        return self._folder / name / f"{newest[0].revision + 1 if newest else 1}.json"


def layouts_router(folder: Path) -> APIRouter:
    """Return the routes of kept layouts, and of drafts, which lie in `drafts` beside them.

    Their handlers run in threads: a disk that is slow keeps no touch waiting.
    """
    router = APIRouter(responses={412: {"model": m.Error}})
    layouts, drafts = KeptTexts(folder), KeptTexts(folder.parent / "drafts", most_versions=1)

    @router.get("/layouts")
    def names(removed: bool = False) -> tuple[str, ...]:
        """Names of the layouts that are kept, or of those that were removed and can be read."""
        return tuple(layouts.names(removed))

    @router.get("/layouts/{name}", response_model=m.LayoutDocument)
    def get_layout(name: Name) -> Response:
        """A layout; its `ETag`, the revision, is for `If-Match`."""
        return _answer(*layouts.read(name))

    @router.put("/layouts/{name}", status_code=204, response_model=None)
    def put_layout(name: Name, document: JsonObject, if_match: IfMatch = None) -> Response:
        """Keep a layout: a new one, or with `If-Match` over the one that has this `ETag`."""
        text = read_layout(document).model_dump_json(exclude_none=True)
        if if_match is None and len(layouts.names()) >= MOST_LAYOUTS:
            raise Problem("limit", f"expected at most {MOST_LAYOUTS} layouts; remove one")
        return _written(layouts.write(name, text, if_match))

    @router.delete("/layouts/{name}", status_code=204)
    def delete_layout(name: Name, if_match: IfMatch = None) -> None:
        """Remove a layout. Its versions stay; the last one can be kept again."""
        layouts.remove(name, if_match)

    @router.post("/layouts/{name}/rename", status_code=204)
    def rename_layout(name: Name, body: Rename, if_match: IfMatch = None) -> None:
        """Give a layout another name, with its versions."""
        layouts.rename(name, body.to, if_match)

    @router.get("/layouts/{name}/versions")
    def versions(name: Name) -> tuple[Version, ...]:
        """The last versions of a layout, the newest first, also of a removed one."""
        return tuple(layouts.versions(name))

    @router.get("/layouts/{name}/versions/{revision}", response_model=m.LayoutDocument)
    def get_version(name: Name, revision: int) -> Response:
        """A version of a layout."""
        return _answer(*layouts.read(name, revision))

    @router.get("/drafts")
    def all_drafts() -> tuple[Version, ...]:
        """Drafts, the newest first."""
        unsorted = (version for name in drafts.names() for version in drafts.versions(name))
        return tuple(sorted(unsorted, key=lambda one: -one.unix_s))

    @router.get("/drafts/{name}", response_model=Draft)
    def get_draft(name: Name) -> Response:
        """A draft; its `ETag` is for `If-Match`."""
        return _answer(*drafts.read(name))

    @router.put("/drafts/{name}", status_code=204, response_model=None)
    def put_draft(name: Name, body: Draft, if_match: IfMatch = None) -> Response:
        """Keep a draft, apart from what is kept; of more than 100 the oldest is removed."""
        revision = drafts.write(name, body.model_dump_json(), if_match)
        for old in all_drafts()[MOST_DRAFTS:]:
            drafts.remove(old.name, _etag(old.revision))
        return _written(revision)

    @router.delete("/drafts/{name}", status_code=204)
    def delete_draft(name: Name, if_match: IfMatch = None) -> None:
        """Remove a draft."""
        drafts.remove(name, if_match)

    return router


def read_layout(document: dict[str, Any]) -> m.LayoutDocument:
    """Read a layout as the session does: from JSON, which knows lists and no tuples."""
    try:
        return m.LayoutDocument.model_validate_json(json.dumps(document))
    except ValidationError as error:
        first = error.errors()[0]
        path = "".join(f"/{part}" for part in first["loc"])
        raise Problem("document", f"{path[1:]}: {first['msg']}", path) from None


def _etag(revision: int) -> str:
    return f'"{revision}"'


def _answer(text: str, revision: int) -> Response:
    """Answer with what was kept as it is: a layout of an older version opens, too."""
    return Response(text, media_type="application/json", headers={"etag": _etag(revision)})


def _written(revision: int) -> Response:
    return Response(status_code=204, headers={"etag": _etag(revision)})
