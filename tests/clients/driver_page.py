"""A page that is the host of a driver, and the package's modules beside it, on a port."""

import contextlib
import functools
import http.server
import threading
from pathlib import Path

PAGE = Path(__file__).with_name("driver_page.html")
PACKAGE = Path(__file__).parents[2] / "clients" / "engine"


class _Handler(http.server.SimpleHTTPRequestHandler):
    def do_GET(self):
        if self.path.partition("?")[0] != "/":
            return super().do_GET()
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.end_headers()
        self.wfile.write(PAGE.read_bytes())

    def log_message(self, *_):
        pass


@contextlib.contextmanager
def served():
    """The address, while this is entered."""
    server = http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(_Handler, directory=PACKAGE)
    )
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}/"
    server.shutdown()
    server.server_close()
