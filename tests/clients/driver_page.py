"""A page that is the host of a driver, and the package's modules beside it, on a port."""

import contextlib
import functools
import http.server
import threading
from pathlib import Path
from typing import ClassVar

PAGE = Path(__file__).with_name("driver_page.html")
PACKAGE = Path(__file__).parents[2] / "clients" / "engine"


class _Handler(http.server.SimpleHTTPRequestHandler):
    added: ClassVar[dict[str, tuple[str, bytes]]] = {}

    def do_GET(self):
        added = self.added.get(self.path)
        if self.path.partition("?")[0] == "/":
            added = "text/html", PAGE.read_bytes()
        if added is None:
            return super().do_GET()
        self.send_response(200)
        self.send_header("content-type", added[0])
        self.end_headers()
        self.wfile.write(added[1])

    def log_message(self, *_):
        pass


@contextlib.contextmanager
def served(added=None):
    """The address, while this is entered; `added` are types and contents of further paths."""
    handler = type("Handler", (_Handler,), {"added": added or {}})
    server = http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(handler, directory=PACKAGE)
    )
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}/"
    server.shutdown()
    server.server_close()
