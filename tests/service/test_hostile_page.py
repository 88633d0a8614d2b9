"""A hostile page in a real Chromium: it must not arm, read assets or learn serial numbers."""

import hashlib
import http.server
import threading

import httpx
import pytest

from tests.chromium import chromium
from tests.service.service_under_test import Service
from tests.waiting import pause

PAGE = b"<!doctype html><title>hostile</title><body></body>"

ATTACK = """
async ([base, digest, token]) => {
    const found = {};
    const attempt = async (name, make) => {
        try { found[name] = await make(); } catch (error) { found[name] = "refused"; }
    };
    const reads = async (path, options) => (await fetch(base + path, options)).text();
    await attempt("server", () => reads("/v1/server"));
    await attempt("devices", () => reads("/v1/devices"));
    await attempt("devices with a stolen token", () =>
        reads("/v1/devices", {headers: {Authorization: "Bearer " + token}}));
    await attempt("pair", () => reads("/v1/pair", {
        method: "POST", headers: {"Content-Type": "application/json"},
        body: JSON.stringify({code: "AAAAAAAA", name: "hostile"})}));
    await attempt("stop", () => reads("/stop", {method: "POST", mode: "no-cors"}));
    await attempt("form", () => new Promise((done) => {
        const frame = document.createElement("iframe");
        frame.name = "answer";
        document.body.append(frame);
        const form = document.createElement("form");
        Object.assign(form, {action: base + "/stop", method: "post", target: "answer"});
        document.body.append(form);
        frame.onload = () => done("sent");
        form.submit();
        setTimeout(() => done("sent"), 1000);
    }));
    await attempt("asset", () => new Promise((done, fail) => {
        const image = new Image();
        image.onload = () => done("loaded " + image.width);
        image.onerror = fail;
        image.src = base + "/v1/assets/" + digest;
    }));
    await attempt("script", () => new Promise((done, fail) => {
        const script = document.createElement("script");
        script.onload = () => done("loaded");
        script.onerror = fail;
        script.src = base + "/v1/openapi.json";
        document.body.append(script);
    }));
    await attempt("socket", () => new Promise((done, fail) => {
        const socket = new WebSocket(base.replace("http", "ws") + "/v1/session", "haptix.v1");
        socket.onopen = () => done("open");
        socket.onerror = fail;
    }));
    return found;
}
"""


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    service = Service(tmp_path_factory.mktemp("service"))
    yield service
    service.close()


@pytest.fixture(scope="module")
def other_site():
    """A page of another origin on this machine."""

    class Page(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(PAGE)

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Page)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.server_address[1]
    server.shutdown()


@pytest.fixture(scope="module")
def browser():
    # Chromium's own barrier between sites and this machine is off: ours must hold alone.
    with chromium(
        "--host-resolver-rules=MAP rebound.example 127.0.0.1",
        without=("LocalNetworkAccessChecks", "BlockInsecurePrivateNetworkRequests"),
    ) as browser:
        yield browser


@pytest.mark.parametrize("where", ["another origin", "a rebound name", "a rebound name of ours"])
def test_a_hostile_page_gets_nothing(service, other_site, browser, where):
    content = b"\x89PNG not a picture"
    digest = hashlib.sha256(content).hexdigest()
    own = {"Authorization": f"Bearer {service.access.native}"}
    httpx.put(
        f"http://127.0.0.1:{service.port}/v1/assets/{digest}",
        params={"suffix": ".png"},
        content=content,
        headers=own,
    )
    # A rebound name makes the service itself look like the attacker's own site.
    base = f"http://127.0.0.1:{service.port}"
    if where != "another origin":
        base = f"http://rebound.example:{service.port}"
    page = browser.new_page()
    host = "127.0.0.1" if where == "another origin" else "rebound.example"
    if where == "a rebound name of ours":
        answer = page.goto(f"{base}/v1/server")
        assert answer.status == 421
    else:
        page.goto(f"http://{host}:{other_site}/")
    found = page.evaluate(ATTACK, [base, digest, service.access.native])
    page.close()
    # These need no reading: they may be sent, and must not be obeyed.
    found.pop("stop")
    assert found.pop("form") == "sent"
    if where == "another origin":
        pair = found.pop("pair")  # any page may try a code, and is told that it is wrong
        assert '"access"' in pair and "token" not in pair
    for name, text in found.items():
        assert text == "refused" or "no name of the service" in text, name
        assert "SECRET7" not in text
    pause(0.1)
    assert not service.engine.told


def test_a_page_that_shows_the_code_comes_in(service, other_site, browser):
    page = browser.new_page()
    page.goto(f"http://127.0.0.1:{other_site}/")
    welcome = page.evaluate(
        """
        async ([base, code]) => {
            const answer = await fetch(base + "/v1/pair", {
                method: "POST", headers: {"Content-Type": "application/json"},
                body: JSON.stringify({code, name: "a friendly page"})});
            const {token} = await answer.json();
            const socket = new WebSocket(base.replace("http", "ws") + "/v1/session", "haptix.v1");
            await new Promise(done => { socket.onopen = done; });
            socket.send(JSON.stringify(
                {type: "hello", id: 1, protocol: "1.0", client: "page", token}));
            const message = await new Promise(done => { socket.onmessage = done; });
            socket.close();
            return JSON.parse(message.data);
        }
        """,
        [f"http://127.0.0.1:{service.port}", service.access.code()],
    )
    page.close()
    assert welcome["type"] == "welcome"
