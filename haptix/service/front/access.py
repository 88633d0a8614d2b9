"""Access control: address, TLS, host names, origins, pairing codes, tokens, and rates.

Any page in a browser can open a socket to this machine, and any name can be made to point here.
So the Host is checked against rebinding and the Origin against foreign pages, and a session needs a
token. A page gets one for the code on the terminal; a program of this user reads one from the file
``service.json``. A token is valid for the origin that it was given to.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import secrets
import socket
import ssl
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from haptix.base.errors import DeviceError, HaptixError, InputError
from haptix.base.files import read_json, remove_drafts, set_aside, write_whole
from haptix.service.protocol.limiter import Limiter
from haptix.service.protocol.messages import Problem

CODE_S = 300.0  # a code is good for so long, and for one page
_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ23456789"  # without letters that look alike
_CODE_LETTERS = 8
_MOST_TRIES, _TRIES_S = 5, 60.0  # of one origin at once, and until as many more
_MOST_ORIGINS = 1000  # whose tries are remembered
_ALL_TRIES, _NEAR_LETTERS = 600, 3
"""Of all origins together: the tries whose first letters are those of the code. Others count for
their own origin alone: who makes up origins finds those letters once in 32,768 tries, and cannot
use up the tries of who reads them."""
_SHOW_S = 3.0  # between two codes on the terminal
_MOST_TOKENS = 100


class Listen(NamedTuple):
    """Where other machines reach the service, always by TLS.

    Parameters
    ----------
    host : str
        Name or address of this machine that clients use.
    certificate, key : Path
        Certificate of that name and its key, in PEM.
    """

    host: str
    certificate: Path
    key: Path


def listens(host: str, port: int) -> socket.socket:
    """Return a socket whose connections send at once.

    Raises `DeviceError` if the port is taken.
    """
    try:
        listener = socket.create_server((host, port))
    except OSError as error:
        raise DeviceError(
            f"cannot listen on {host}, port {port}: {error.strerror or error}; give a name of this "
            "machine and a --port that no other service has"
        ) from None
    # asyncio does so only for sockets that it made itself. Otherwise a ping or an event waits until
    # the client's system acknowledges the one before, 40 ms later (Nagle's algorithm, RFC 896).
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def check_certificate(listen: Listen) -> None:
    """Raise `InputError` if TLS cannot use the certificate."""
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(listen.certificate, listen.key)
    except OSError as error:  # an SSLError is one
        raise InputError(
            f"expected a certificate and its key in PEM, got {listen.certificate} and "
            f"{listen.key}: {error}"
        ) from None


class Access:
    """Keeper of the tokens.

    Parameters
    ----------
    port : int
        Port that the service listens on.
    folder : Path
        Where tokens of pages are remembered, as hashes, and where ``service.json`` is written.
        Other users may read neither.
    hosts : tuple of str
        Further names by which the service is reached, with ``--listen``.
    now_s : callable
        The clock.
    """

    def __init__(
        self,
        port: int,
        folder: Path,
        hosts: tuple[str, ...] = (),
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        names = ("127.0.0.1", "localhost", "[::1]", *hosts)
        self.hosts = frozenset(f"{name}:{port}" for name in names)
        scheme = "https" if hosts else "http"
        host = hosts[0] if hosts else "127.0.0.1"
        self._url = f"{'wss' if hosts else 'ws'}://{host}:{port}/v1/session"
        self.origins = frozenset(f"{scheme}://{host}" for host in self.hosts)
        self._now_s = now_s
        self.folder = folder
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        remove_drafts(self.folder)  # layouts and assets lie below it
        self._pages: dict[str, dict[str, str]] = self._load()
        self._tries: dict[str, Limiter] = {}  # by origin, the latest last
        self._all_tries = Limiter(_ALL_TRIES / _TRIES_S, now_s, _ALL_TRIES)
        self._shows = Limiter(1 / _SHOW_S, now_s, 1)
        self._code, self._code_s = "", -1.0
        self.native = secrets.token_urlsafe(32)
        """Token of the programs of this user."""
        self.on_show: Callable[[str], None] = lambda code: None
        """Shows a code on the terminal."""
        self._port = self.stop_port = port
        self.write_entry(port)

    def write_entry(self, stop_port: int) -> None:
        """Write ``service.json``; STOP has a port of its own once the service has begun."""
        self.stop_port = stop_port
        entry = {"url": self._url, "port": self._port, "stop_port": stop_port}
        entry["token"] = self.native
        self._write("service.json", _json(entry))

    def close(self) -> None:
        """Take back the token of native programs."""
        self.native = secrets.token_urlsafe(32)
        (self.folder / "service.json").unlink(missing_ok=True)

    def is_own_host(self, host: str | None) -> bool:
        """Whether a request's Host is a name of this service (DNS rebinding shows another)."""
        return host is not None and host.lower() in self.hosts

    def is_known_origin(self, origin: str | None) -> bool:
        """Whether a page of this origin may connect; programs send none."""
        return origin is None or origin in self.origins or self._paired(origin)

    def code(self) -> str:
        """Return the code that pairs a page now."""
        if not self._code or self._now_s() - self._code_s > CODE_S:
            self._code = "".join(secrets.choice(_LETTERS) for _ in range(_CODE_LETTERS))
            self._code_s = self._now_s()
        return self._code

    def show_code(self) -> None:
        """Show the code on the terminal, for a page that asks for it.

        Raises `Problem` if it was shown a moment ago.
        """
        if not self._shows.takes():
            raise Problem("limit", "the terminal shows a code already")
        self.on_show(self.code())

    def pair(self, code: str, origin: str | None, name: str) -> str:
        """Return a token for a page that shows the code.

        Raises `Problem` if the code is another one, too old or used, or after five tries in a
        minute; `OSError` if the token cannot be kept; the code is good still.
        """
        if not origin or origin == "null":
            raise Problem("access", "expected a page with an origin; programs read service.json")
        typed_code = code.strip().upper().replace("-", "")
        is_near = _is_same(typed_code[:_NEAR_LETTERS], self.code()[:_NEAR_LETTERS])
        if not self._may_try(origin) or (is_near and not self._all_tries.takes()):
            raise Problem("limit", f"expected at most {_MOST_TRIES} tries a minute; wait a minute")
        if not _is_same(typed_code, self.code()):
            raise Problem("access", "this is not the code that the terminal shows", "/code")
        token = secrets.token_urlsafe(32)
        pages = dict([*self._pages.items()][1 - _MOST_TOKENS :])
        pages[_hash(token)] = {"origin": origin, "name": name[:100]}
        self._write("tokens.json", _json(pages))  # a full disk spends no code
        self._pages, self._code = pages, ""
        return token

    def _may_try(self, origin: str) -> bool:
        """Whether an origin has tries left."""
        new = Limiter(_MOST_TRIES / _TRIES_S, self._now_s, _MOST_TRIES)
        self._tries[origin] = own = self._tries.pop(origin, new)
        if len(self._tries) > _MOST_ORIGINS:
            self._tries.pop(next(iter(self._tries)))
        return own.takes()

    def write_entrance(self, address: str) -> Path:
        """Write a page that forwards to an address; other users of this machine cannot read it.

        All users see a browser's start address in the list of processes.
        """
        page = f'<!doctype html><meta http-equiv="refresh" content="0; url={address}">'
        return self._write("studio.html", page.encode())

    def forget(self, token: str) -> None:
        """Take back a page's token."""
        if self._pages.pop(_hash(token), None) is not None:
            self._write("tokens.json", _json(self._pages))

    def lets_in(self, token: str, origin: str | None) -> bool:
        """Whether a token was given to this origin, or to the programs of this user.

        A browser names no origin when one of the service's own pages reads by GET; those of other
        origins it names.
        """
        if origin is None and _is_same(token, self.native):
            return True
        page = self._pages.get(_hash(token))
        if page is None:
            return False
        return page["origin"] in self.origins if origin is None else page["origin"] == origin

    def owner_of(self, token: str) -> str:
        """Return the owner of a valid token: a page's origin, or "programs" of this user."""
        page = self._pages.get(_hash(token))
        return "programs" if page is None else page["origin"]

    def _paired(self, origin: str) -> bool:
        return any(page["origin"] == origin for page in self._pages.values())

    def _load(self) -> dict[str, dict[str, str]]:
        path = self.folder / "tokens.json"
        if not path.exists():
            return {}
        try:
            pages = read_json(path)
        except HaptixError as error:  # pages pair again; none gets in by a damaged file
            set_aside(path, error)
            return {}
        return {
            str(key): {"origin": str(page["origin"]), "name": str(page["name"])}
            for key, page in pages.items()
            if isinstance(page, dict) and {"origin", "name"} <= page.keys()
        }

    def _write(self, name: str, content: bytes) -> Path:
        path = self.folder / name
        write_whole(path, content, is_secret=True)
        return path


def _json(content: object) -> bytes:
    return json.dumps(content).encode()


def _is_same(text: str, secret: str) -> bool:
    """Compare in constant time, so that the time reveals nothing of the secret."""
    return hmac.compare_digest(text.encode(), secret.encode())


def _hash(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
