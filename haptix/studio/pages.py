"""The files of the pages, and what a browser may do with them."""

from __future__ import annotations

from pathlib import Path

_HERE = Path(__file__).parent
_COPY = _HERE / "client"  # of the client for pages, in a wheel
_CHECKOUT = _HERE.parents[1] / "clients" / "typescript" / "src"
FOLDERS = {"studio": _HERE / "static", "client": _COPY if _COPY.is_dir() else _CHECKOUT}
"""Folders whose files anyone of this machine may read, by the first part of the address."""


def page_file(folder: str, path: str) -> Path | None:
    """Return a file of the pages; None if there is none of that name."""
    root = FOLDERS[folder].resolve()
    found = (root / path).resolve()
    return found if found.is_relative_to(root) and found.is_file() else None


def stop_origin(host: str) -> str:
    """Return where the STOP button's frame comes from, for pages at `host`.

    It must be another site than the page's, so that a browser gives it a process of its own: then
    it works while the page's script hangs. ``localhost`` is one for pages on ``127.0.0.1``.
    """
    name, _, port = host.rpartition(":")
    return f"http://localhost:{port}" if name == "127.0.0.1" else "'self'"


def policy(host: str) -> str:
    """Content-Security-Policy of the pages: nothing from elsewhere, no script within a page."""
    own = f"ws://{host} wss://{host}"
    return "; ".join(
        [
            "default-src 'none'",
            "script-src 'self'",
            "style-src 'self'",
            "worker-src 'self'",
            "img-src 'self' blob: data:",
            f"connect-src 'self' {own}",
            f"frame-src {stop_origin(host)}",
            "form-action 'self'",
            "base-uri 'none'",
            "frame-ancestors 'none'",
        ]
    )


def stop_policy(origins: frozenset[str]) -> str:
    """Content-Security-Policy of the STOP button, which the service's own pages frame."""
    return "; ".join(
        [
            "default-src 'none'",
            "script-src 'self'",
            "style-src 'self'",
            "connect-src 'self'",
            "form-action 'self'",
            "base-uri 'none'",
            f"frame-ancestors {' '.join(sorted(one for one in origins if '[' not in one))}",
        ]
    )
