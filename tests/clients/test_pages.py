"""Ordinary events of pages, in a real browser against the real front."""

import http.server
import json
import shutil
import threading
from contextlib import contextmanager

import pytest

from tests.chromium import chromium
from tests.made_clients import TYPESCRIPT
from tests.waiting import wait_for

ALLOWED = "LocalNetworkAccessChecks"  # a person does that
HEAD = "<!doctype html><meta charset=utf-8><body style='margin:0'>"
PAD = "<div id=pad style='width:400px;height:200px;background:#ddd'></div>"
SCRIPT = """
<script type=module>
  import { connect, pair } from "/src/haptix.js";
  const query = new URLSearchParams(location.search);
  const url = query.get("url");
  window.told = [];
  window.opens = async (code) => {
    try {
      if (code) await pair({ code, name: "page", url });
      const h = (window.h = await connect({ name: "page", url }));
      for (const kind of ["warning", "contact", "resumed"]) h.on(kind, (event) => told.push(event));
      window.mine = h.lease.is_mine;
      await h.geometry({ px_per_mm: 4 });
      await h.acquire();
      await h.arm();
      window.ready = true;
    } catch (error) {
      window.failed = error.message;
    }
  };
  if (!query.has("waits")) await opens(query.get("code"));
  window.loaded = true;
</script>
"""
PAGES = {
    "page": HEAD + PAD + SCRIPT,
    "pad": HEAD + PAD,
    "long": HEAD + PAD + "<div style='height:4000px'></div>" + SCRIPT,
}


class Handler(http.server.SimpleHTTPRequestHandler):
    """The client's sources, and pages that are made here."""

    def __init__(self, *args):
        super().__init__(*args, directory=str(TYPESCRIPT))

    def do_GET(self):
        name = self.path.partition("?")[0].strip("/")
        if name not in PAGES:
            super().do_GET()
            return
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.end_headers()
        self.wfile.write(PAGES[name].encode())

    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def server():
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def browser():
    with chromium(without=[ALLOWED]) as browser:
        yield browser


@contextmanager
def launched(launch, *arguments, options=()):
    """A browser of other rules, beside the first."""
    common = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    one = launch(*arguments, executable_path=shutil.which("chromium"), args=[*common, *options])
    yield one
    one.close()


def address_of(server, service, page="page", host="127.0.0.1", **query):
    query |= {"url": f"ws://127.0.0.1:{service.port}/v1/session"}
    text = "&".join(f"{name}={value}" for name, value in query.items())
    return f"http://{host}:{server.server_address[1]}/{page}?{text}"


def is_ready(frame):
    frame.wait_for_function("window.ready || window.failed")
    assert frame.evaluate("window.failed") is None


@pytest.fixture(scope="module")
def visitor(browser, server, service):
    """Someone whose pages are paired."""
    context = browser.new_context(has_touch=True)
    page = context.new_page()
    page.goto(address_of(server, service, code=service.access.code()))
    is_ready(page)
    page.evaluate("h.close()")
    page.close()
    yield context
    context.close()


@contextmanager
def opened(visitor, server, service, page="page"):
    """A page that is armed."""
    service.engine.reports.clear()
    one = visitor.new_page()
    one.goto(address_of(server, service, page))
    is_ready(one)
    yield one
    one.evaluate("h.close()")
    one.close()


def test_a_reloaded_page_has_its_token_and_its_lease_back(visitor, server, service):
    with opened(visitor, server, service) as page:
        before = service.hub.control.holder
        page.reload()
        is_ready(page)
        assert page.evaluate("mine") and service.hub.control.holder is not before


def test_an_iframe_of_another_site_without_storage_has_both_back(
    browser, server, service, tmp_path
):
    """`localhost` is another site than 127.0.0.1, and this browser keeps nothing for it."""
    settings = tmp_path / "Default" / "Preferences"
    settings.parent.mkdir()
    rules = {"cookie_controls_mode": 1, "block_third_party_cookies": True}
    settings.write_text(json.dumps({"profile": rules}))
    frame = address_of(server, service, host="localhost", waits=1)
    PAGES["around"] = f"{HEAD}<iframe src='{frame}'></iframe>"
    with launched(browser.browser_type.launch_persistent_context, tmp_path) as strict:
        page = strict.new_page()
        page.goto(address_of(server, service, "around"))
        for code, again in (service.access.code(), "here"), ("", "around"), ("", None):
            child = page.frames[1]
            child.wait_for_function("window.loaded")
            refusal = "(() => { try { localStorage } catch (error) { return error.name } })()"
            assert child.evaluate(refusal) == "SecurityError"
            child.evaluate("(code) => opens(code)", code)
            is_ready(child)
            assert child.evaluate("mine") == (code == "")
            if again == "here":
                child.evaluate("void location.reload()")
                page.wait_for_timeout(500)
            elif again == "around":
                page.reload()
        child.evaluate("h.close()")


def test_events_of_an_iframe_that_was_made_later_are_felt(visitor, server, service):
    """Its events count from another time; the client is in the page around it."""
    with opened(visitor, server, service) as page:
        page.evaluate("pad.remove()")
        page.wait_for_timeout(700)
        page.evaluate(
            """() => new Promise((resolve) => {
                const frame = document.createElement("iframe");
                frame.style = "border:0; width:500px; height:300px";
                frame.onload = () => {
                    h.follow(frame.contentDocument.getElementById("pad"));
                    resolve();
                };
                frame.src = "/pad";
                document.body.append(frame);
            })"""
        )
        page.mouse.move(40, 20)
        page.mouse.down()
        page.mouse.move(80, 20, steps=4)
        page.mouse.up()
        reports = service.engine.reports
        wait_for(lambda: reports and reports[-1].kind == "up")
        assert [reports[0].kind, reports[0].x_mm, reports[0].y_mm] == ["down", 10.0, 5.0]
        assert reports[-1].x_mm == 20.0
        assert page.evaluate("h.dropped") == 0 and page.evaluate("told.length") >= 1


@pytest.mark.parametrize("style", ["zoom: 2", "scale: 2; transform-origin: 0 0"])
def test_a_zoomed_element_has_its_regions_where_it_shows_them(visitor, server, service, style):
    with opened(visitor, server, service) as page:
        page.evaluate("(style) => { pad.style.cssText += style; h.follow(pad); }", style)
        page.mouse.move(80, 40)
        page.mouse.down()
        page.mouse.up()
        reports = service.engine.reports
        wait_for(lambda: reports and reports[-1].kind == "up")
        # 80 px on the screen are 40 of the element
        assert (reports[0].x_mm, reports[0].y_mm) == (10.0, 5.0)


def swipe(page, dx, dy):
    client = page.context.new_cdp_session(page)
    send = client.send

    def at(kind, share):
        points = [{"x": 200 + dx * share, "y": 150 + dy * share}] if kind != "touchEnd" else []
        send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    at("touchStart", 0.0)
    for step in range(1, 11):
        at("touchMove", step / 10)
    at("touchEnd", 1.0)


@pytest.mark.parametrize("scroll, scrolls", [("vertical", True), ("none", False)])
def test_a_page_scrolls_by_a_stroke_along_and_a_stroke_across_is_felt(
    visitor, server, service, scroll, scrolls
):
    with opened(visitor, server, service, "long") as page:
        page.evaluate("(scroll) => h.follow(pad, { scroll })", scroll)
        reports = service.engine.reports
        swipe(page, 120, 0)
        wait_for(lambda: reports and reports[-1].kind == "up")
        across = [one.x_mm for one in reports]
        assert page.evaluate("scrollY") == 0 and max(across) - min(across) > 20.0
        reports.clear()
        swipe(page, 0, -120)
        wait_for(lambda: reports and reports[-1].kind == "up")  # also where the browser scrolls
        page.wait_for_timeout(100)
        assert (page.evaluate("scrollY") > 20) == scrolls


def test_a_hidden_page_lifts_its_fingers_and_a_lost_socket_leaves_their_regions(
    visitor, server, service
):
    with opened(visitor, server, service) as page:
        page.evaluate("void h.follow(pad)")
        page.mouse.move(40, 20)
        page.mouse.down()
        reports = service.engine.reports
        wait_for(lambda: reports)
        page.evaluate(
            """() => {
                Object.defineProperty(document, "hidden", { value: true, configurable: true });
                document.dispatchEvent(new Event("visibilitychange"));
            }"""
        )
        wait_for(lambda: reports[-1].kind == "up")
        page.wait_for_function("told.some((one) => one.event === 'enter')")
        service.hub.control.holder.close(1012, "cut")
        page.wait_for_function("told.some((one) => one.event === 'leave' && one.region === 'ribs')")
        page.wait_for_function("told.some((one) => one.type === 'welcome')")


def test_a_public_page_is_told_what_its_browser_misses(browser, server, service):
    port = server.server_address[1]
    secure = f"http://app.example:{port},http://other.example:{port}"
    rules = [
        f"--ip-address-space-overrides=127.0.0.1:{port}=public",
        "--host-resolver-rules=MAP *.example 127.0.0.1",
        f"--unsafely-treat-insecure-origin-as-secure={secure}",
    ]
    with launched(browser.browser_type.launch, options=rules) as strict:

        def outcome(host, around=None, permissions=()):
            context = strict.new_context(permissions=[*permissions])
            page = context.new_page()
            address = address_of(server, service, host=host, waits=1)
            if around:
                PAGES["around"] = f"{HEAD}<iframe {around} src='{address}'></iframe>"
                page.goto(f"http://other.example:{port}/around")
            else:
                page.goto(address)
            frame = page.frames[-1]
            frame.wait_for_function("window.loaded")
            frame.evaluate("(code) => opens(code)", service.access.code())
            said = frame.evaluate("window.failed")
            if said is None:
                frame.evaluate("h.close()")
            context.close()
            return said

        assert "want https" in outcome("insecure.example")
        assert "site's settings" in outcome("app.example")  # without a window nobody is asked
        granted = ["local-network-access"]
        assert outcome("app.example", permissions=granted) is None
        allow = 'allow="loopback-network; local-network-access"'
        assert f"<iframe {allow}>" in outcome("app.example", "title=pad")
        assert outcome("app.example", allow, granted) is None
