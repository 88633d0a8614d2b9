"""Many connections, floods, and what nobody foresaw: STOP works, and each is told why."""

import errno
import json
import resource
import socket
import ssl
import time
from contextlib import ExitStack, suppress

import httpx
import pytest
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from haptix.service.front import application, connections, session_socket
from haptix.service.front.application import SUBPROTOCOL
from haptix.service.front.connections import MOST_CONNECTIONS
from tests.service.service_under_test import Service, certified
from tests.service.test_sessions import Client
from tests.waiting import PATIENCE_S, wait_for

SPOKEN = Subprotocol(SUBPROTOCOL)
HALF = b"POST /v1/pair HTTP/1.1\r\nHost: 127.0"


@pytest.fixture
def service(tmp_path, monkeypatch):
    """A service that shows nobody out for being late: on a slow machine its own test is."""
    monkeypatch.setattr(session_socket, "_LONGEST_BEHIND_S", float("inf"))
    running = Service(tmp_path / "service")
    yield running
    running.close()


def stop(service):
    """STOP over HTTP, as the button does."""
    before = len(service.engine.when("stop"))
    answer = httpx.post(f"http://127.0.0.1:{service.port}/stop", timeout=PATIENCE_S)
    assert answer.status_code == 204
    assert len(service.engine.when("stop")) == before + 1


@pytest.mark.parametrize("begin", [b"", HALF, HALF + b".0.1\r\nContent-Length: 9\r\n\r\n{"])
def test_a_crowd_that_says_nothing_keeps_nobody_from_stop(service, begin):
    with Client(service).holds() as client, ExitStack() as stack:
        for _ in range(MOST_CONNECTIONS + 50):
            one = stack.enter_context(socket.create_connection(("127.0.0.1", service.port)))
            with suppress(ConnectionError):  # its place may be another one's already
                one.sendall(begin)
        wait_for(lambda: len(service.server.crowd.connections) <= MOST_CONNECTIONS)
        stop(service)
        assert client.ask("inventory")["type"] == "inventory"  # a session keeps its place
        with Client(service) as newcomer:
            assert newcomer.welcome["type"] == "welcome"


def test_handshakes_that_are_never_done_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(connections, "MOST_CONNECTIONS", 20)
    listen = certified(tmp_path)
    service = Service(tmp_path / "service", listen=listen)
    crowd = service.server.crowd.connections
    try:
        with ExitStack() as stack:
            silent = [
                stack.enter_context(socket.create_connection(("localhost", service.port)))
                for _ in range(60)
            ]
            silent[0].settimeout(PATIENCE_S)
            with suppress(ConnectionError):
                assert silent[0].recv(1) == b""  # it was quiet for the longest
            trusts = ssl.create_default_context(cafile=listen.certificate)
            url = f"https://localhost:{service.port}/stop"
            assert httpx.post(url, verify=trusts, timeout=PATIENCE_S).status_code == 204
            wait_for(lambda: 0 < len(crowd) <= 20)
        wait_for(lambda: not crowd)
    finally:
        service.close()


@pytest.mark.parametrize(
    ("head", "limit"),
    [
        ("POST /v1/pair HTTP/1.1\r\nContent-Length: 900", "BODY_S"),
        ("POST /v1/pair HTTP/1.1\r\nTransfer-Encoding: chunked", "BODY_S"),
        (f"PUT /v1/assets/{'0' * 64}?suffix=.png HTTP/1.1\r\nContent-Length: 900", "FILE_S"),
    ],
)
def test_a_body_that_comes_too_slowly_is_refused(service, monkeypatch, head, limit):
    """One byte every now and then is no reason to go on waiting."""
    monkeypatch.setattr(application, limit, 0.2)
    token = f"Authorization: Bearer {service.access.native}"
    lines = (head, f"Host: 127.0.0.1:{service.port}", token, "", "")
    heard = b""
    with socket.create_connection(("127.0.0.1", service.port), timeout=PATIENCE_S) as slow:
        slow.sendall("\r\n".join(lines).encode())
        slow.settimeout(0.05)
        end_s = time.monotonic() + PATIENCE_S
        while b"}" not in heard and time.monotonic() < end_s:
            with suppress(TimeoutError):
                slow.sendall(b"1\r\n{\r\n" if "chunked" in head else b"{")
                heard += slow.recv(4096)
        slow.settimeout(PATIENCE_S)
        with suppress(ConnectionError):  # more may have come after it had closed
            assert slow.recv(1) == b""
    assert heard.startswith(b"HTTP/1.1 408")
    assert b"expected the whole body within 0.2 s" in heard


def spoken(service):
    """A session's socket of no library, whose client reads little."""
    one = socket.socket()
    one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    one.settimeout(PATIENCE_S)
    one.connect(("127.0.0.1", service.port))
    one.sendall(
        f"GET /v1/session HTTP/1.1\r\nHost: 127.0.0.1:{service.port}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: {SUBPROTOCOL}\r\n\r\n".encode()
    )
    assert b" 101 " in one.recv(4096)
    return one


def test_pongs_that_nobody_reads_end_their_connection(service):
    pings = (b"\x89\xfd" + bytes(4) + bytes(125)) * 500
    with spoken(service) as one, pytest.raises(ConnectionError):
        while True:
            one.sendall(pings)


def test_a_message_in_endless_pieces_ends_its_connection(service):
    piece = b"\x00\x80" + bytes(4)
    with spoken(service) as one:
        one.sendall(b"\x01\x80" + bytes(4) + piece * 1000 + b"\x80\x80" + bytes(4))
        assert b'"error"' in one.recv(4096)  # a message of no text, taken as such
        one.sendall(b"\x01\x80" + bytes(4))
        with pytest.raises(ConnectionError):
            while True:
                one.sendall(piece * 100)


def test_the_process_may_open_enough_files(service):
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    assert soft >= min(hard, 1024) or hard == resource.RLIM_INFINITY


@pytest.mark.parametrize("kind", ["inventory", "acquire", "stop", "layout_change"])
def test_a_stop_waits_for_nothing_that_its_client_has_sent(service, kind):
    """And what was sent before it does nothing after it."""
    with Client(service) as flooder, Client(service).holds() as other:
        ops = {"ops": [{"op": "remove", "name": "none"}]} if kind == "layout_change" else {}
        first = flooder.number + 1
        for number in range(first, first + 900):  # for 4.5 s, at 200 a second
            flooder.socket.send(json.dumps({"type": kind, "id": number, **ops}))
            with suppress(TimeoutError):  # who does not read what is answered is closed
                while True:
                    flooder.socket.recv(timeout=0)
        service.engine.told.clear()
        began_s = time.monotonic()
        flooder.socket.send(json.dumps({"type": "arm", "id": first + 900}))
        flooder.socket.send(json.dumps({"type": "stop", "id": first + 901}))
        wait_for(lambda: service.engine.when("stop"))
        sessions = service.hub.sessions
        flooding = sessions.get(flooder.welcome["session"])
        if kind != "stop" and time.monotonic() - began_s < 2.0:  # else a slow machine had the time
            assert flooding is None or flooding.ahead  # others still wait
        assert other.ask("inventory")["type"] == "inventory"
        assert not service.engine.when("arm")
        assert other.welcome["session"] in sessions
        flooder.socket.socket.close()  # answers to hundreds of messages may still come


def test_a_flood_has_little_of_a_turn(service, monkeypatch):
    """Another session's stop waits for some turns, so each has to be short."""
    pieces = []
    receive = WebSocketsSansIOProtocol.data_received
    monkeypatch.setattr(
        WebSocketsSansIOProtocol,
        "data_received",
        lambda protocol, data: (pieces.append(len(data)), receive(protocol, data)),
    )
    with Client(service) as flooder:
        text = json.dumps({"type": "layout_set", "id": 2, "document": {"a": "x" * 500_000}})
        flooder.socket.send(text)
        assert flooder.until(lambda message: message["type"] == "error")
    assert 500_000 < sum(pieces) < 510_000
    assert max(pieces) <= 4096


def test_many_errors_at_once_are_all_told(service):
    """It is no fault of a client that its answers are not written yet."""
    with Client(service) as client:
        for _ in range(150):
            client.socket.send("no JSON")
        client.say("inventory")
        client.until(lambda message: message["type"] == "inventory")
        assert sum(message["type"] == "error" for message in client.heard) == 150


def test_a_flood_is_kept_up_to_a_size_and_told(service):
    """And its stop is still read."""
    with Client(service).holds() as flooder:
        service.engine.told.clear()
        number = flooder.number + 1
        big = json.dumps({"type": "x" * 60_000})
        session = service.hub.sessions[flooder.welcome["session"]]
        for _ in range(150):
            flooder.socket.send(big)
            assert session.ahead_bytes <= 5 * 2**20
        told = flooder.until(lambda message: message.get("code") == "limit")
        assert "left out" in told["sentence"]
        flooder.socket.send(json.dumps({"type": "stop", "id": number + 1000}))
        wait_for(lambda: service.engine.when("stop"))


def test_who_sends_more_than_can_be_read_is_shown_out_at_0_v(service, monkeypatch):
    monkeypatch.setattr(session_socket, "_LONGEST_BEHIND_S", -1.0)  # as on a machine without time
    with Client(service) as other, Client(service).holds() as flooder:
        flooder.ask("arm")
        service.engine.told.clear()
        text = json.dumps({"type": "inventory", "id": flooder.number + 1})
        with suppress(ConnectionClosed):
            for _ in range(100_000):
                flooder.socket.send(text)
                with suppress(TimeoutError):
                    while True:
                        flooder.socket.recv(timeout=0)
        wait_for(lambda: service.engine.when("stop"))
        assert service.hub.control.output.state == "off"
        with pytest.raises(ConnectionClosed, match="more than can be read"):
            while True:
                flooder.socket.recv(PATIENCE_S)
        assert other.ask("inventory")["type"] == "inventory"


PATHS = (
    *("/studio/%00", "/client/%00", "/studio/" + "x" * 5000, "/studio/" + "a/" * 3000),
    *("/%ff/\u00e9", "/studio/..%2f..%2f..%2fetc/passwd", "/studio/%2e%2e/x", "/v1/layouts/%00"),
    "/stop/x" * 900,
)


def test_every_path_is_answered_by_a_sentence(service, capfd):
    headers = {"authorization": f"Bearer {service.access.native}"}
    for path in PATHS:
        for method in ("GET", "PUT", "POST", "DELETE"):
            url = f"http://127.0.0.1:{service.port}{path}"
            answer = httpx.request(method, url, headers=headers, timeout=PATIENCE_S)
            assert 400 <= answer.status_code < 500, (method, path)
            assert len(answer.json()["sentence"]) > 20, (method, path, answer.text)
            assert "Traceback" not in answer.text
    assert "Traceback" not in "".join(capfd.readouterr())


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), 507, "MB free; make room"),
        (OSError(errno.EIO, "Input/output error"), 500, "cannot be kept: Input/output error"),
        (ZeroDivisionError("a fault of ours"), 500, "a fault of the service: ZeroDivisionError"),
    ],
)
def test_a_full_disk_and_a_fault_of_ours_are_said_as_such(
    service, monkeypatch, capfd, error, status, words
):
    def fails(*_):
        raise error

    monkeypatch.setattr("haptix.service.front.assets.tempfile.mkstemp", fails)
    answer = httpx.put(
        f"http://127.0.0.1:{service.port}/v1/assets/{'0' * 64}?suffix=.png",
        headers={"authorization": f"Bearer {service.access.native}"},
        content=b"x",
        timeout=PATIENCE_S,
    )
    assert answer.status_code == status
    assert words in answer.json()["sentence"]
    assert "Traceback" not in "".join(capfd.readouterr())
    with Client(service) as client:
        service.hub.engine.ask = fails
        told = client.ask("layout_set", document={"regions": []})
        assert (told["code"], "layout_set: " in told["sentence"]) == ("internal", True)


def test_bytes_that_are_no_text_leave_no_traceback(service, capfd):
    address = f"ws://127.0.0.1:{service.port}/v1/session"
    with connect(address, subprotocols=[SPOKEN], proxy=None) as client:
        client.socket.sendall(b"\x81\x82\x00\x00\x00\x00\xff\xfe")
        with pytest.raises(ConnectionClosed):
            client.recv(PATIENCE_S)
    assert "Traceback" not in "".join(capfd.readouterr())
