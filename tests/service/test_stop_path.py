"""STOP on a path of its own, while all else is crowded."""

import asyncio
import json
import socket
import threading
from contextlib import ExitStack, suppress

import httpx
import pytest

from haptix.service.client.connection import connect
from haptix.service.front.connections import MOST_CONNECTIONS
from haptix.service.front.stop_path import StopPath
from tests.service.service_under_test import Service
from tests.waiting import PATIENCE_S, pause


@pytest.fixture
def service(tmp_path, monkeypatch):
    monkeypatch.setenv("HAPTIX_SERVICE", str(tmp_path / "service"))
    running = Service(tmp_path / "service")
    yield running
    running.close()


def press(service, method="POST", where="/stop", **headers):
    url = f"http://127.0.0.1:{service.stop_path.port}{where}"
    return httpx.request(method, url, headers=headers, timeout=PATIENCE_S).status_code


def test_it_stops_and_does_nothing_else(service):
    port = service.stop_path.port
    token = {"authorization": f"Bearer {service.access.native}"}
    assert press(service, "GET", "/v1/server", **token) == press(service, "GET") == 404
    assert press(service, "POST", "/v1/pair", **token) == 404
    assert press(service, **{"sec-fetch-site": "cross-site"}) == 403
    assert press(service, host=f"rebound.example:{port}") == 421
    assert not service.engine.when("stop")
    assert press(service, **{"sec-fetch-site": "same-site"}) == 204
    assert len(service.engine.when("stop")) == 1
    assert press(service, host=f"localhost:{port}") == 204
    entry = json.loads((service.folder / "service.json").read_text())
    assert (entry["port"], entry["stop_port"]) == (service.port, port)


def test_it_is_reached_from_this_machine_alone_and_keeps_no_connection(service):
    port = service.stop_path.port
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.2", port), timeout=PATIENCE_S)
    answer = httpx.post(f"http://127.0.0.1:{port}/stop", timeout=PATIENCE_S)
    assert answer.headers["connection"] == "close"


def test_it_answers_once_the_services_own_loop_has_stopped():
    """However busy that loop is; nothing of the service is touched by another thread."""
    stopped, seen = [], []

    def presses(port):
        httpx.post(f"http://127.0.0.1:{port}/stop", timeout=PATIENCE_S)
        seen.append([*stopped])

    async def serves():
        path = StopPath(lambda reason: stopped.append((reason, threading.current_thread())))
        thread = threading.Thread(target=presses, args=(path.port,))
        thread.start()
        pause(0.3)  # the loop does something else
        await asyncio.to_thread(thread.join)
        await asyncio.to_thread(path.close)

    asyncio.run(serves())
    assert seen == [[("stopped by the button", threading.main_thread())]]


@pytest.mark.parametrize("begin", [b"", b"POST /stop HTTP/1.1\r\nHost: 127.0"])
@pytest.mark.parametrize("which", ["port", "stop_port"])
def test_crowds_keep_nobody_from_it(service, begin, which):
    port = json.loads((service.folder / "service.json").read_text())[which]
    with ExitStack() as stack:
        for _ in range(MOST_CONNECTIONS + 50):
            one = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
            with suppress(ConnectionError):  # its place may be another one's already
                one.sendall(begin)
        assert press(service) == 204
    assert service.engine.when("stop")


def test_the_button_knows_the_path_on_this_machine(service):
    own = f"http://localhost:{service.stop_path.port}/stop"
    page = httpx.get(f"http://localhost:{service.port}/stop", timeout=PATIENCE_S)
    assert f'data-own="{own}"' in page.text
    assert f"connect-src 'self' {own};" in page.headers["content-security-policy"]


def test_a_client_goes_both_paths(service):
    with connect("app") as client:
        client.stop()
    assert len(service.engine.when("stop")) >= 2
