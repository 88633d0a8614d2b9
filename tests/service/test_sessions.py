"""Sessions over real sockets, with an engine that writes down what it is told."""

import hashlib
import json
import socket
import threading
import time
from contextlib import ExitStack, suppress

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from haptix.service.front.access import listens
from haptix.service.front.application import SUBPROTOCOL
from haptix.service.protocol.batches import write_touches
from haptix.service.protocol.messages import TouchMessage
from haptix.tasks.login import running_service
from tests.command_line import run_haptix
from tests.service.service_under_test import Service
from tests.waiting import PATIENCE_S, wait_for

PAGE = "https://example.org"
SPOKEN = Subprotocol(SUBPROTOCOL)


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    service = Service(tmp_path_factory.mktemp("service"))
    yield service
    service.close()


@pytest.fixture
def service(running):
    yield running
    wait_for(lambda: not running.hub.sessions)
    running.hub.control._kept = None
    running.engine.__init__()


class Client:
    """A client that speaks JSON by hand."""

    def __init__(self, service, answers=True, token=None, origin=None, **hello):
        self.context = connect(
            f"ws://127.0.0.1:{service.port}/v1/session",
            subprotocols=[SPOKEN],
            origin=origin,
            proxy=None,
            close_timeout=1,
        )
        self.socket = self.context.__enter__()
        self.answers, self.number, self.heard = answers, 0, []
        self.offset_s = 1000.0  # its clock is another
        token = service.access.native if token is None else token
        self.welcome = self.ask("hello", protocol="1.0", client="test", token=token, **hello)

    def say(self, kind, **fields):
        self.number += 1
        self.socket.send(json.dumps({"type": kind, "id": self.number, **fields}))

    def ask(self, kind, **fields):
        self.say(kind, **fields)
        return self.until(lambda message: message["id"] == self.number)

    def until(self, wanted, seconds=PATIENCE_S):
        end_s = time.monotonic() + seconds
        while True:
            message = json.loads(self.socket.recv(timeout=max(end_s - time.monotonic(), 0)))
            if message["type"] == "ping":
                if self.answers:
                    pong = {"type": "pong", "n": message["n"], "clock_s": self.now_s()}
                    self.socket.send(json.dumps(pong))
            else:
                self.heard.append(message)
                if wanted(message):
                    return message

    def now_s(self):
        return time.monotonic() + self.offset_s

    def holds(self):
        assert self.ask("acquire")["type"] == "lease"
        assert self.ask("arm")["state"] == "armed"
        return self

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()


def test_what_is_sent_waits_for_no_acknowledgement():
    with listens("127.0.0.1", 0) as listener, socket.create_connection(listener.getsockname()):
        connection, _ = listener.accept()
        with connection:
            assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1


def test_hello_and_welcome(service):
    with Client(service) as client:
        assert client.welcome["type"] == "welcome"
        assert client.welcome["protocol"] == "1.0"
        assert client.welcome["lease"] == {
            "type": "lease",
            "id": 0,
            "holder": None,
            "is_mine": False,
            "reason": "free",
        }
        assert client.welcome["output"]["state"] == "off"


def test_a_later_client_is_answered_in_our_version(service):
    with Client(service, **{"resume": ""}) as client:
        client.socket.close()
    with connect(
        f"ws://127.0.0.1:{service.port}/v1/session", subprotocols=[SPOKEN], proxy=None
    ) as socket:
        hello = {"type": "hello", "id": 1, "protocol": "1.7", "client": "new"}
        socket.send(json.dumps(hello | {"token": service.access.native}))
        assert json.loads(socket.recv())["protocol"] == "1.0"


@pytest.mark.parametrize(
    ("hello", "code", "path", "closes"),
    [
        ({"protocol": "2.0"}, "version", "/protocol", 4400),
        ({"protocol": "1.0", "token": "guess"}, "access", "/token", 4403),
    ],
)
def test_who_may_not_come_in_is_told_why(service, hello, code, path, closes):
    with connect(
        f"ws://127.0.0.1:{service.port}/v1/session", subprotocols=[SPOKEN], proxy=None
    ) as socket:
        socket.send(json.dumps({"type": "hello", "id": 1, "client": "x"} | hello))
        error = json.loads(socket.recv())
        assert (error["type"], error["id"], error["code"], error["path"]) == (
            "error",
            1,
            code,
            path,
        )
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv()
        assert closed.value.rcvd.code == closes


@pytest.mark.parametrize(
    "headers", [{"origin": PAGE}, {"origin": "null"}, {"headers": {"Host": "rebound.example"}}]
)
def test_foreign_pages_and_names_get_no_socket(service, headers):
    origin = headers.get("origin")
    host = headers.get("headers", {}).get("Host", f"127.0.0.1:{service.port}")
    answer = httpx.get(
        f"http://127.0.0.1:{service.port}/v1/server",
        headers={"Host": host} | ({"Origin": origin} if origin else {}),
    )
    assert answer.status_code == (403 if origin else 421)
    assert "access-control-allow-origin" not in answer.headers
    if origin:
        with pytest.raises(InvalidStatus) as refused:
            connect(
                f"ws://127.0.0.1:{service.port}/v1/session",
                subprotocols=[SPOKEN],
                origin=origin,
                proxy=None,
            )
        assert refused.value.response.status_code == 403


def test_a_page_is_paired_and_comes_in(service):
    base = f"http://127.0.0.1:{service.port}"
    code = service.access.code()
    answer = httpx.post(
        f"{base}/v1/pair", json={"code": code, "name": "page"}, headers={"Origin": PAGE}
    )
    assert answer.headers["access-control-allow-origin"] == PAGE
    token = answer.json()["token"]
    with Client(service, token=token, origin=PAGE) as client:
        assert client.welcome["type"] == "welcome"
    headers = {"Origin": PAGE, "Authorization": f"Bearer {token}"}
    assert httpx.get(f"{base}/v1/server", headers=headers).json()["name"] == "haptix"
    assert httpx.get(f"{base}/v1/server").status_code == 403
    assert httpx.delete(f"{base}/v1/pair", headers=headers).status_code == 204
    assert httpx.get(f"{base}/v1/server", headers=headers).status_code == 403


def test_a_program_of_this_user_reads_the_code_and_a_page_does_not(service, monkeypatch):
    monkeypatch.setenv("HAPTIX_SERVICE", str(service.access.folder))
    assert running_service() == (service.port, service.access.code())
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr("haptix.tasks.cli.service._has_browser", lambda: True)
    run_haptix("studio")  # ends at once: that service has its pages
    assert opened == [f"http://127.0.0.1:{service.port}/#code={service.access.code()}"]
    page = {
        "Origin": PAGE,
        "Authorization": f"Bearer {service.access.pair(service.access.code(), PAGE, 'page')}",
    }
    for headers in (page, {}, {"Authorization": f"Bearer {service.access.native}", "Origin": PAGE}):
        answer = httpx.get(f"http://127.0.0.1:{service.port}/v1/pair/code", headers=headers)
        assert answer.status_code == 403
        assert service.access.code() not in answer.text
    monkeypatch.setenv("HAPTIX_SERVICE", str(service.access.folder / "none"))
    assert running_service() is None


def test_sixty_silent_sockets_show_nobody_out_who_is_about_to_say_hello(service):
    """They come again at once where one is closed, faster than an honest hello comes."""
    address = f"ws://127.0.0.1:{service.port}/v1/session"

    def opens():
        return stack.enter_context(connect(address, subprotocols=[SPOKEN], proxy=None))

    with ExitStack() as stack:
        honest = opens()
        number = max(service.hub.sessions)
        service.hub.sessions[number].began_s = float("inf")  # however slow this machine is
        for _ in range(60):
            opens()
        assert service.hub.sessions[number].closing is None
        hello = {"type": "hello", "id": 1, "protocol": "1.0", "client": "honest"}
        honest.send(json.dumps(hello | {"token": service.access.native}))
        assert json.loads(honest.recv(PATIENCE_S))["type"] == "welcome"


def test_who_says_no_hello_takes_no_place_of_a_session(service, monkeypatch):
    monkeypatch.setattr("haptix.service.front.hub.MOST_STRANGERS", 8)
    address = f"ws://127.0.0.1:{service.port}/v1/session"
    with ExitStack() as stack:
        silent = [
            stack.enter_context(connect(address, subprotocols=[SPOKEN], proxy=None))
            for _ in range(20)  # while 8 may wait, the last ones do
        ]
        with Client(service) as client:
            assert client.welcome["type"] == "welcome"
        with pytest.raises(ConnectionClosed, match="4408"):
            silent[0].recv(PATIENCE_S)
    wait_for(lambda: not service.hub.sessions)


def test_nothing_before_hello_and_every_id_rises(service):
    with connect(
        f"ws://127.0.0.1:{service.port}/v1/session", subprotocols=[SPOKEN], proxy=None
    ) as socket:
        socket.send(json.dumps({"type": "stop", "id": 4}))
        error = json.loads(socket.recv())
        assert (error["code"], error["id"]) == ("order", 4)
    with Client(service) as client:
        client.number = 0
        assert client.ask("inventory")["code"] == "order"


def test_one_holds_the_output_and_a_takeover_is_told_to_both(service):
    with Client(service).holds() as first, Client(service) as second:
        refused = second.ask("acquire")
        assert (refused["code"], refused["path"]) == ("lease", "/takeover")
        assert second.ask("arm")["code"] == "lease"
        service.engine.told.clear()
        mine = second.ask("acquire", takeover=True)
        assert mine["is_mine"]
        assert service.engine.told[0][0] == "stop"  # 0 V before anything else
        lost = first.until(lambda message: message["type"] == "lease" and not message["is_mine"])
        assert lost["holder"] == mine["holder"]
        assert first.ask("arm")["code"] == "lease"
        assert service.hub.control.output.state == "off"  # the new holder is not armed


def test_who_leaves_ends_at_0_v_and_resumes_disarmed(service):
    client = Client(service).holds()
    resume = client.welcome["resume"]
    service.engine.told.clear()
    client.socket.socket.close()  # as when its process is killed
    wait_for(lambda: service.engine.when("stop"))  # how soon is tested with the driver
    with Client(service) as other:
        assert other.ask("acquire")["code"] == "lease"  # it is kept for who lost it
    with Client(service, resume=resume) as again:
        assert again.welcome["lease"]["is_mine"]
        assert again.welcome["output"]["state"] == "off"


def test_a_lost_connection_is_resumed_while_its_old_socket_looks_open(service):
    with Client(service).holds() as first:
        resume = first.welcome["resume"]
        with Client(service, resume=resume) as again:
            assert again.welcome["lease"]["is_mine"]
            assert again.ask("arm")["state"] == "armed"
            # By this number the engine knows its layout.
            assert service.engine.told[-1][:2] == ("arm", {"session": first.welcome["session"]})
            assert service.hub.control.output.state == "armed"
            first.socket.socket.close()
            again.ask("inventory")
            assert service.hub.control.output.state == "armed"


def test_an_app_that_is_started_anew_has_the_lease_and_begins_with_an_empty_layout(service):
    with Client(service, app="word") as first:
        first.holds().ask("mute", on=True)
        with Client(service, app="word") as second:  # the first one runs: nothing is taken
            assert not second.welcome["lease"]["is_mine"]
            assert second.ask("acquire")["code"] == "lease"
        first.socket.socket.close()  # as when its process is killed
        wait_for(lambda: service.engine.when("stop"))
        with Client(service, app="another") as other:
            assert other.ask("acquire")["code"] == "lease"
        with Client(service, app="word") as again:
            assert again.welcome["lease"]["is_mine"]
            assert not again.welcome["output"]["muted"]
            assert ("forget", {"session": first.welcome["session"]}) in [
                one[:2] for one in service.engine.told
            ]
            assert again.ask("arm")["state"] == "armed"
            assert service.engine.told[-1][1] == {"session": again.welcome["session"]}


def test_an_app_that_hung_loses_the_lease_to_itself_started_anew(service):
    with Client(service, app="word").holds():
        wait_for(lambda: service.hub.control.output.state == "asleep")
        with Client(service, app="word") as again:
            assert again.welcome["lease"]["is_mine"]


def test_who_says_goodbye_keeps_nothing(service):
    with Client(service).holds() as first:
        first.say("bye")
        first.until(lambda message: message["type"] == "bye")
        with Client(service) as second:
            assert second.ask("acquire")["is_mine"]


def test_a_silent_client_sleeps_and_a_pong_wakes_it(service):
    with Client(service).holds() as client:
        client.answers = False
        wait_for(lambda: service.engine.when("sleep"))
        assert service.hub.control.output.state == "asleep"
        client.answers = True
        client.until(lambda m: m["type"] == "output" and m["state"] == "armed")
        assert service.engine.when("wake")


def test_anyone_stops_and_what_waits_is_refused(service):
    service.engine.arming_s = 30.0
    with Client(service) as holder, Client(service) as observer:
        holder.ask("acquire")
        holder.say("arm")
        holder.say("intensity", value=0.5)
        waits = holder.number
        wait_for(lambda: any(session.requests for session in service.hub.sessions.values()))
        assert observer.ask("stop")["type"] == "done"
        refused = holder.until(lambda m: m["id"] == waits)
        assert refused["code"] == "order" and "stopped by session" in refused["sentence"]
        assert service.hub.control.output.state == "off" or not service.engine.when("arm")
        assert service.engine.when("stop")


def test_the_button_needs_no_script(service):
    with Client(service).holds() as client:
        base = f"http://127.0.0.1:{service.port}"
        far = httpx.post(f"{base}/stop", headers={"Sec-Fetch-Site": "cross-site"})
        assert far.status_code == 403 and service.hub.control.output.state != "off"
        assert httpx.post(f"{base}/stop").status_code == 204
        client.until(lambda m: m["type"] == "output" and m["state"] == "off")


def test_touches_in_bytes_and_in_json_by_the_clients_clock(service):
    with Client(service).holds() as client:
        client.ask("geometry", px_per_mm=4.0, origin_mm=[10.0, 5.0], rotation_deg=90.0)
        at_s = client.now_s()
        client.socket.send(write_touches([TouchMessage(t_s=at_s, x_px=40.0, y_px=0.0)], 1))
        client.ask("touch", touches=[{"t_s": at_s, "x_mm": 1.5, "y_mm": 2.5, "kind": "up"}])
        pixels, millimetres = service.engine.reports
        assert pixels.t_s == pytest.approx(at_s - client.offset_s, abs=0.5)
        assert (pixels.x_mm, pixels.y_mm) == pytest.approx((10.0, 15.0))
        assert (millimetres.x_mm, millimetres.y_mm, millimetres.kind) == (1.5, 2.5, "up")
        wrong = client.ask("touch", touches=[{"t_s": time.time() * 1e3, "x_mm": 1, "y_mm": 2}])
        assert (wrong["code"], wrong["path"]) == ("clock", "/touches/0/t_s")
        assert len(service.engine.reports) == 2
        half = client.ask("touch", touches=[{"t_s": client.now_s(), "x_mm": 1}])
        assert half["path"] == "/touches/0"


def test_only_the_touches_that_cannot_be_used_are_left_out(service):
    with Client(service).holds() as client:
        now_s = client.now_s()
        touches = [
            TouchMessage(t_s=now_s - 0.7, x_mm=1.0, y_mm=2.0),
            TouchMessage(t_s=now_s, x_mm=3.0, y_mm=4.0),
            TouchMessage(t_s=now_s, x_px=3.0, y_px=4.0),
            TouchMessage(t_s=now_s, x_mm=5.0, y_mm=6.0),
        ]
        client.socket.send(write_touches(touches, 1))
        error = client.until(lambda message: message["type"] == "error")
        assert (error["code"], error["path"]) == ("clock", "/touches/0/t_s")
        assert "1 more" in error["sentence"]
        as_json = [touch.model_dump() for touch in touches]
        refused = client.ask("touch", touches=as_json)
        assert refused["path"] == "/touches/0/t_s"
        refused = client.ask("touch", touches=as_json[1:])
        assert (refused["code"], refused["path"]) == ("order", "/touches/1/x_px")
        places = [report.x_mm for report in service.engine.reports]
        assert places == [3.0, 5.0] * 3


@pytest.mark.parametrize("as_json", [False, True])
def test_nothing_keeps_a_lift_out(service, as_json):
    """Its force is 0, as a page's pressure, its time another's, its pixels of no geometry."""
    with Client(service).holds() as client:
        now_s = client.now_s()
        changes = [
            {"normal_force_n": 0.0, "contact_area_m2": 0.0},
            {"t_s": now_s - 100.0},
            {"t_s": now_s + 100.0},
            {"x_mm": None, "y_mm": None, "x_px": 3.0, "y_px": 4.0},
            {"x_mm": 1e7},
        ]
        fields = {"t_s": now_s, "kind": "up", "x_mm": 1.0, "y_mm": 2.0}
        for change in changes:
            touch = fields | change
            if as_json:
                assert client.ask("touch", touches=[touch])["type"] == "done"
                continue
            data = bytearray(write_touches([TouchMessage(**touch)], 1))
            data[16 + 5] |= 8 | 16  # the force and the area are known to be 0
            client.socket.send(bytes(data))
        reports = service.engine.reports
        wait_for(lambda: len(reports) == len(changes))
        assert {report.kind for report in reports} == {"up"}
        assert {report.normal_force_n for report in reports} == {None}
        age_s = [client.now_s() - client.offset_s - report.t_s for report in reports]
        assert 0.5 < age_s[1] < PATIENCE_S and all(one >= 0.0 for one in age_s)


def test_a_force_of_zero_of_a_finger_that_is_down_is_explained(service):
    with Client(service).holds() as client:
        data = bytearray(write_touches([TouchMessage(t_s=client.now_s(), x_mm=1, y_mm=2)], 1))
        data[16 + 5] |= 8
        client.socket.send(bytes(data))
        refused = client.until(lambda message: message["type"] == "error")
        assert "0.001" in refused["sentence"] and "leave it out" in refused["sentence"]


def test_a_finger_whose_lift_was_lost_is_lifted(service, monkeypatch):
    """As it comes down again, and else after ten seconds without a report."""
    with Client(service).holds() as client:
        down = {"x_mm": 1.0, "y_mm": 2.0, "kind": "down"}
        for _ in range(2):
            client.ask("touch", touches=[down | {"t_s": client.now_s(), "touch_id": 3}])
        client.ask("touch", touches=[down | {"t_s": client.now_s(), "touch_id": 4}])
        reports = service.engine.reports
        assert [(one.touch_id, one.kind) for one in reports] == [
            (3, "down"), (3, "up"), (3, "down"), (4, "down"),
        ]  # fmt: skip
        monkeypatch.setattr("haptix.service.front.client_session._FORGOTTEN_S", 0.01)
        wait_for(lambda: len(reports) == 6)
        assert {(one.touch_id, one.kind) for one in reports[4:]} == {(3, "up"), (4, "up")}


def test_who_arms_while_armed_goes_on(service):
    with Client(service).holds() as client:
        again = client.ask("arm")
        assert (again["type"], again["state"]) == ("output", "armed")
        assert len(service.engine.when("arm")) == 1


@pytest.mark.parametrize(("fails_after", "state"), [(True, "failed"), (False, "armed")])
def test_a_driver_that_fails_as_it_is_armed_is_not_called_armed(
    service, monkeypatch, fails_after, state
):
    """Its failure is read before the one who armed hears of the success; or it failed before."""

    async def ask(do, **fields):
        if do == "arm":
            event = {"event": "output", "state": "failed", "reason": "unplugged", "number": 1}
            service.hub.on_engine_event(event)
        return {"revision": 1, "told": 0 if fails_after else 1}

    monkeypatch.setattr(service.engine, "ask", ask)
    with Client(service) as client:
        client.ask("layout_set", layout={"regions": []})
        client.ask("acquire")
        assert client.ask("arm")["state"] == state
        assert service.hub.control.output.state == state


@pytest.mark.parametrize("end", ["all_left", "output"])
def test_each_region_is_left_as_often_as_entered(service, end):
    """By who is on it when the output stops, or the engine dies; not by a holder before."""

    def told(**event):
        loop = service.server.servers[0].get_loop()
        loop.call_soon_threadsafe(service.hub.on_engine_event, event)

    with Client(service).holds() as client:
        contact = {"event": "contact", "touch_id": 0, "t_s": time.monotonic(), "value": None}
        mine = contact | {"session": client.welcome["session"]}
        told(**contact, session=-1, what="enter", region="of another")
        for what, region in (
            ("enter", "ribs"), ("press", "ok"), ("enter", "rim"), ("detent", "rim"),
            ("leave", "rim"),
        ):  # fmt: skip
            told(**mine, what=what, region=region)
        told(event=end, state="failed", reason="the engine died") if end == "output" else told(
            event=end
        )
        told(event="warning", sentence="last")
        client.until(lambda message: message["type"] == "warning")
        heard = [(one["event"], one["region"]) for one in client.heard if one["type"] == "contact"]
        assert heard == [
            ("enter", "ribs"), ("press", "ok"), ("enter", "rim"), ("detent", "rim"),
            ("leave", "rim"), ("leave", "ribs"), ("release", "ok"), ("leave", "ok"),
        ]  # fmt: skip
    service.hub.control.set(state="off", reason="the test ends")


def test_touches_that_are_left_out_are_told_ten_times_a_second_at_most(service):
    with Client(service).holds() as client:
        stale = TouchMessage(t_s=client.now_s() - 9.0, x_mm=1.0, y_mm=2.0)
        began_s = time.monotonic()
        for number in range(200):  # it reads nothing meanwhile, and would be disconnected
            client.socket.send(write_touches([stale], number))
        assert client.ask("inventory")["type"] == "inventory"
        told = sum(message["type"] == "error" for message in client.heard)
        assert 1 <= told <= 10 + 10 * (time.monotonic() - began_s)


def test_what_waits_for_the_engine_is_bounded_and_stop_is_not(service):
    service.engine.arming_s = 30.0
    with Client(service) as client:
        client.ask("acquire")
        client.say("arm")
        for _ in range(62):
            client.say("mute", on=False)
        refused = client.until(lambda message: message["type"] == "error")
        assert refused["code"] == "limit" and refused["id"] == 64  # 1 to 3 were done, 60 wait
        client.say("stop")
        stopped = client.number
        assert client.until(lambda message: message["id"] == stopped)["type"] == "done"


def test_an_engine_that_refuses_leaves_the_session_as_it_was(service):
    with Client(service) as client:
        client.ask("acquire")
        service.engine.refuses["arm"] = "no driver is there"
        refused = client.ask("arm")
        assert (refused["code"], refused["sentence"]) == ("device", "no driver is there")
        assert service.hub.control.output.state == "off"
        service.engine.refuses.clear()
        assert client.ask("arm")["state"] == "armed"


MANY = write_touches([TouchMessage(t_s=0.0, x_mm=1.0, y_mm=1.0)] * 1024, 1)
REGION = {"name": "x" * 90, "material": {"kind": "x" * 100}}
FLOODS = {
    "pongs": lambda n: json.dumps({"type": "pong", "n": 10**9, "clock_s": 0}),
    "no JSON": lambda n: "{" * 15 + "x" * 60_000,
    "brackets": lambda n: "[" * 60_000,
    "strings": lambda n: '"' + "\\\\" * 30_000,
    "layouts": lambda n: json.dumps(
        {"type": "layout_set", "id": n, "document": {"regions": [REGION] * 200}}
    ),
    "other bytes": lambda n: b"\x00" * 60_000,
    "touches": lambda n: MANY,
    "questions": lambda n: json.dumps({"type": "inventory", "id": n}),
}


#: What the limits of a session let through each second; a text counts once more for each 4 KiB.
PER_S = dict.fromkeys(FLOODS, 200 / 15) | {
    "pongs": 200,
    "questions": 200,
    "layouts": 200 / 12,
    "other bytes": 1200,
    "touches": 12000 / 1024,
}


@pytest.mark.parametrize("kind", FLOODS)
def test_a_flood_slows_its_sender_only(service, monkeypatch, kind):
    make = FLOODS[kind]
    with Client(service) as flooder, Client(service).holds() as other:
        service.engine.told.clear()
        sent = [make(number) for number in range(10, 410)]

        flooding, taken = service.hub.sessions[flooder.welcome["session"]], []
        receive = service.hub.receive

        def receives(session, data):
            if session is flooding:
                taken.append(data)
            return receive(session, data)

        monkeypatch.setattr(service.hub, "receive", receives)

        def floods():
            with suppress(ConnectionClosed):
                for data in sent:
                    flooder.socket.send(data)

        flood = threading.Thread(target=floods)
        flood.start()
        for _ in range(10):
            assert other.ask("inventory")["type"] == "inventory"
        seconds = 1 + time.monotonic() - flooding.began_s  # what a bucket holds at first is one
        assert len(taken) <= seconds * PER_S[kind] + 2
        assert not service.engine.when("stop")
        flooder.socket.socket.close()  # it reads no answers, so it would not hear the farewell
        flood.join()


def test_an_oversized_message_closes_its_own_session(service):
    with Client(service) as client, Client(service) as other:
        with pytest.raises(ConnectionClosed) as closed:
            client.socket.send("x" * 5_000_000)
            client.until(lambda message: False)
        # The system drops the farewell where bytes of the message were not read.
        assert closed.value.rcvd is None or closed.value.rcvd.code == 1009
        assert other.ask("inventory")["type"] == "inventory"


def test_a_file_is_kept_under_its_hash(service):
    base = f"http://127.0.0.1:{service.port}/v1/assets"
    content = b"a photograph"
    digest = hashlib.sha256(content).hexdigest()
    headers = {"Authorization": f"Bearer {service.access.native}"}

    def put(name=digest, body=content, suffix=".png", **changes):
        return httpx.put(
            f"{base}/{name}", params={"suffix": suffix}, content=body, headers=headers | changes
        ).status_code

    assert httpx.get(f"{base}/{digest}", headers=headers).status_code == 404
    assert put(Authorization="") == 403
    assert put(body=b"another") == put(suffix=".exe") == 422
    assert put(name="../../etc/passwd") == put(name="0" * 63) == 404
    assert put(body=b"x" * (32 * 2**20 + 1)) == 429
    assert [put(), put()] == [201, 200]
    got = httpx.get(f"{base}/{digest}", headers=headers)
    assert got.content == content and got.headers["x-content-type-options"] == "nosniff"


def settings(service):
    """What the engine was told last of strength, mute and pause."""
    names = ("intensity", "mute", "pause")
    told = {do: fields for do, fields, _ in service.engine.told if do in names}
    return {do: next(iter(fields.values())) for do, fields in told.items()}


def test_what_an_app_mutes_and_weakens_ends_with_its_lease(service):
    with Client(service) as first, Client(service) as second:
        first.ask("acquire")
        assert first.ask("mute", on=True)["muted"]
        first.ask("pause", on=True)
        first.ask("intensity", value=0.25)
        second.ask("acquire", takeover=True)
        assert settings(service) == {"mute": False, "pause": False, "intensity": 1.0}
        assert not service.hub.control.output.muted
        first.ask("acquire", takeover=True)  # its own are the same session's still
        assert settings(service) == {"mute": True, "pause": True, "intensity": 0.25}
    wait_for(lambda: settings(service) == {"mute": False, "pause": False, "intensity": 1.0})


def test_who_resumes_finds_its_settings_again(service):
    client = Client(service)
    client.ask("acquire")
    client.ask("mute", on=True)
    client.socket.close()
    wait_for(lambda: settings(service) == {"mute": False})
    with Client(service, resume=client.welcome["resume"]) as again:
        assert again.welcome["output"]["muted"]
        assert settings(service) == {"mute": True}


@pytest.mark.parametrize("name", ["person.json", "tokens.json"])
@pytest.mark.parametrize(
    "content", [b"", b'{"person_intens', b"[1, 2]", b"\xff", b'{"person_muted": 7}']
)
def test_a_damaged_file_of_its_own_is_set_aside_and_the_service_begins(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    service = Service(tmp_path)
    try:
        assert service.hub.control.output.person_intensity == 1.0
        is_readable = name == "tokens.json" and content.startswith(b'{"person_muted')
        if not is_readable:
            assert (tmp_path / f"{name}.damaged").read_bytes() == content
            assert not path.exists()
    finally:
        service.close()


def test_the_person_s_own_strength_and_mute_stay(service):
    base = f"http://127.0.0.1:{service.port}/v1/person"
    headers = {"authorization": f"Bearer {service.access.native}"}
    wanted = {"person_intensity": 0.5, "person_muted": True}
    assert httpx.put(base, json=wanted, headers=headers).status_code == 204
    with Client(service) as client:
        client.ask("acquire")
        output = client.ask("intensity", value=0.5)
        assert (output["intensity"], output["person_intensity"]) == (0.5, 0.5)
        assert settings(service) == {"mute": True, "intensity": 0.25}
        assert client.ask("mute", on=False)["person_muted"]
        assert settings(service)["mute"] is True  # no app takes the person's mute away
    wait_for(lambda: settings(service) == {"mute": True, "intensity": 0.5})
    for half in ({"person_intensity": 1.0}, {"person_muted": False}, {}, wanted | {"muted": False}):
        assert httpx.put(base, json=half, headers=headers).status_code == 422
    assert httpx.get(base, headers=headers).json() == wanted
    again = Service(service.folder)  # the next start of the service
    assert again.hub.control.output.person_muted
    again.close()
    free = {"person_intensity": 1.0, "person_muted": False}
    assert httpx.put(base, json=free, headers=headers).status_code == 204


@pytest.mark.parametrize(
    ("wrong", "why"),
    [({"x_mm": 1e6}, "got 1e+06, 0 mm"), ({"touch_id": 10}, "at most 10 fingers at once")],
)
def test_a_touch_that_no_finger_makes_is_refused_and_the_others_count(service, wrong, why):
    with Client(service).holds() as client:
        right = [{"touch_id": finger, "x_mm": 1.0, "y_mm": 0.0} for finger in range(10)]
        touches = [*right, {"x_mm": 0.0, "y_mm": 0.0} | wrong]
        stamped = [{"t_s": client.now_s(), "kind": "down"} | touch for touch in touches]
        refused = client.ask("touch", touches=stamped)
        assert refused["type"] == "error" and why in refused["sentence"]
        assert {report.touch_id for report in service.engine.reports} == set(range(10))
        lifted = [{"t_s": client.now_s(), "kind": "up", "touch_id": 3}]
        eleventh = [{"t_s": client.now_s(), "touch_id": 10, "x_mm": 1.0, "y_mm": 0.0}]
        assert client.ask("touch", touches=[*lifted, *eleventh])["type"] == "done"


def test_as_many_regions_as_welcome_says_come_in_one_message(service):
    with Client(service).holds() as client:
        limits = client.welcome["limits"]
        material = {"kind": "grating", "period_mm": 2.0, "note": "x" * 3000}  # 4 KiB of each
        regions = [{"name": f"region {n}", "material": material} for n in range(limits["regions"])]
        document = {"regions": regions}
        assert len(json.dumps(document)) > 700_000
        assert client.ask("layout_set", document=document)["type"] == "layout"
        assert len(service.engine.told[-1][1]["document"]["regions"]) == limits["regions"]
        refused = client.ask("layout_set", document=document | {"note": "x" * 2**20})
        assert refused["code"] == "limit" and "1048576 bytes" in refused["sentence"]
        assert service.hub.control.output.state != "off"  # and the output goes on


def test_who_has_shown_no_token_sends_little(service):
    address = f"ws://127.0.0.1:{service.port}/v1/session"
    with connect(address, subprotocols=[SPOKEN], proxy=None) as socket:
        socket.send(json.dumps({"type": "hello", "id": 1, "client": "x" * 5000}))
        assert json.loads(socket.recv())["sentence"] == "expected at most 4096 bytes of text"
