"""The Python client, with and without await, against the real front."""

import asyncio
import gc
import logging
import subprocess
import sys
import threading

import numpy as np
import pytest

import haptix.service.client.connection
from haptix.base.errors import DeviceError, HaptixError, InputError
from haptix.service.front import client_touches
from haptix.service.front.jobs import Job
from haptix.service.protocol import messages as m
from haptix.service.protocol.limiter import Limiter
from haptix.service.protocol.messages import JobMessage
from tests.waiting import PATIENCE_S, wait_for


@pytest.fixture
def connect(service, monkeypatch):
    monkeypatch.setenv("HAPTIX_SERVICE", str(service.access.folder))
    service.engine.reports.clear()
    return haptix.service.client.connection.connect


def test_touches_go_out_in_order_and_contacts_come_back(service, connect, monkeypatch):
    # A busy machine may stand for longer than a touch may be old.
    monkeypatch.setattr(client_touches, "PAST_S", PATIENCE_S)
    with connect("test") as h:
        events = []
        h.on("contact", events.append)
        h.acquire()
        assert h.arm().state == "armed"
        at_s = h.now_s()
        h.touch(1.0, 2.0, 0.5, touch_id=3, kind="down", t_s=at_s)
        for number in range(100):
            h.touch(float(number), 2.0, touch_id=3)
        h.lift(3)
        wait_for(lambda: service.engine.reports and service.engine.reports[-1].kind == "up")
        places = [report.x_mm for report in service.engine.reports]
        # Of moves that a busy machine delivers late, the service may leave out all but the newest.
        moves = places[1:-1]
        assert places[0] == 1.0 and places[-1] == 0.0
        assert moves == sorted({*moves}) and {*moves} <= {*map(float, range(100))}
        assert moves[-1] == 99.0
        wait_for(lambda: events)
        # Half a round trip of loopback, on a busy machine.
        assert events[0].touch_id == 3 and abs(events[0].t_s - at_s) < 0.5


def test_touches_that_wait_keep_their_order(service, connect, monkeypatch):
    """Also where the later one would wait for less, as on a machine that is busy between."""
    waits = iter([0.1, 0.0, 0.0])
    with connect("test") as h:
        h.acquire()
        h.arm()
        monkeypatch.setattr(h._client._batches, "wait_s", lambda: next(waits))
        h.touch(1.0, 2.0, kind="down")
        h.touch(2.0, 2.0)
        h.lift()
        wait_for(lambda: len(service.engine.reports) == 3)
    assert [one.kind for one in service.engine.reports] == ["down", "move", "up"]


def test_a_broken_connection_is_opened_again_with_the_lease_and_disarmed(service, connect, caplog):
    caplog.set_level(logging.INFO, "haptix.service.client.connection")
    with connect("test") as h:
        told, contacts = [], []
        for kind in ("lost", "resumed"):
            h.on(kind, lambda event, kind=kind: told.append((kind, event)))
        h.on("contact", contacts.append)
        h.ask("geometry", px_per_mm=4.0)
        h.acquire()
        h.arm()
        h.touch(1.0, 1.0, touch_id=2, kind="down")
        wait_for(lambda: contacts)
        first = h.welcome.session
        with pytest.raises(DeviceError):  # the echoing engine closes all sockets
            h.ask("play", effect={"kind": "cut"})
        wait_for(lambda: len(told) == 2)
        (_, lost), (_, welcome) = told
        assert [(one.event, one.touch_id) for one in contacts] == [("enter", 2), ("leave", 2)]
        assert "cut" in lost.reason and not lost.is_final
        assert welcome is h.welcome and welcome.session != first
        assert welcome.lease.is_mine and welcome.output.state == "off"
        logged = [
            each.getMessage()
            for each in caplog.records
            if each.name == "haptix.service.client.connection"
        ]
        assert logged[0] == "the connection is lost: cut"
        assert logged[1].startswith("connects again in ")
        assert logged[-1] == f"connected again as session {welcome.session}"
        h.arm()
        count = len(service.engine.reports)
        h.touches(
            [haptix.service.protocol.messages.TouchMessage(t_s=h.now_s(), x_px=40.0, y_px=0.0)]
        )
        wait_for(lambda: len(service.engine.reports) > count)
        assert service.engine.reports[-1].x_mm == 10.0  # the geometry was told again


def test_a_job_is_watched_over_a_broken_connection_and_told_what_was_missed(service, connect):
    fields = {"kind": "surface", "state": "running"}
    job, gone = (
        Job("programs", JobMessage(job=name, **fields), {}, lambda _: None) for name in ("a1", "b2")
    )
    jobs = service.hub.jobs.jobs
    jobs.update(a1=job, b2=gone)
    with connect("test") as h:
        told = []
        for kind in ("job", "resumed"):
            h.on(kind, told.append)
        assert h.watch("a1").state == h.watch("b2").state == "running"
        job.message = job.message.model_copy(update={"state": "done"})  # while nobody hears
        del jobs["b2"]
        h.acquire()
        h.arm()
        with pytest.raises(DeviceError):
            h.ask("play", effect={"kind": "cut"})
        wait_for(lambda: any(event.type == "welcome" for event in told))
        assert [(one.job, one.state) for one in told if one.type == "job"] == [("a1", "done")]
        session = service.hub.sessions[h.welcome.session]
        assert session.watched == {"a1"}
    del jobs["a1"]


def test_a_handler_that_fails_or_asks_ends_nothing(service, connect, caplog):
    with connect("test") as h:
        failures = []

        def asks(_):
            try:
                h.ask("inventory")
            except InputError as error:
                failures.append(error)
                raise

        h.on("lease", asks)
        h.acquire()
        wait_for(lambda: failures)
        assert h.ask("inventory").devices
        assert "handler of lease failed" in caplog.text


def test_after_close_nothing_is_sent_and_no_thread_is_left(service, connect):
    before = threading.active_count()
    h = connect("test")
    h.acquire()
    h.close()
    with pytest.raises(DeviceError, match="closed"):
        h.touch(1.0, 1.0)
    with pytest.raises(DeviceError, match="closed"):
        h.stop()
    assert threading.active_count() == before
    wait_for(lambda: service.hub.control.holder is None)


def test_a_wrong_token_is_no_reason_to_try_again(service, connect):
    address = f"ws://127.0.0.1:{service.port}/v1/session"
    with pytest.raises(haptix.service.client.connection.Refused) as refused:
        connect("test", address, "guess")
    assert (refused.value.code, refused.value.path) == ("access", "/token")
    with pytest.raises(DeviceError, match="start haptix serve"):
        connect("test", "ws://127.0.0.1:1/", "x")


@pytest.mark.parametrize("wrong", [2, 100])
def test_a_token_that_is_old_on_connecting_again_is_read_anew_for_a_while(service, connect, wrong):
    """A service that begins opens its port before it writes the new token."""
    h = connect("test")
    find, ended, resumed = h._client._find, [], []
    tokens = iter(["old"] * wrong)
    h._client._find = lambda: (find()[0], next(tokens, find()[1]))
    h.on("closed", ended.append)
    h.on("resumed", resumed.append)
    service.hub.sessions[h.welcome.session].close(1012, "cut")
    wait_for(lambda: ended or resumed)
    assert len(resumed) == (wrong == 2)
    h.close()
    assert wrong == 2 or (ended[0].is_final and "token" in ended[0].reason)


def test_a_program_that_ends_without_close_leaves(service, connect):
    program = """
import haptix
haptix.service.feel({"kind": "grating", "period_mm": 2.0}, "short")
"""
    before = len(service.engine.when("layout_set"))
    subprocess.run([sys.executable, "-c", program], check=True, timeout=PATIENCE_S)
    assert len(service.engine.when("layout_set")) == before + 1
    with connect("next") as h:
        h.acquire()  # else it is refused for 30 s


def test_with_await(service, connect):
    async def plays():
        async with await haptix.service.client.connection.connect_async("test") as h:
            await h.acquire()
            await h.arm()
            await h.touch(7.0, 8.0)
            resumed = asyncio.Event()
            h.on("resumed", lambda _: resumed.set())
            with pytest.raises(DeviceError):
                await h.ask("play", effect={"kind": "cut"})
            await asyncio.wait_for(resumed.wait(), PATIENCE_S)
            assert h.welcome.lease.is_mine

    asyncio.run(plays())
    assert service.engine.reports[0].x_mm == 7.0


def test_a_layout_by_calls_plain_and_with_await(service, connect):
    ribs = {"kind": "grating"}
    with connect("test") as h:
        service.engine.told.clear()
        region = h.layout.add(ribs, x_mm=1.0, width_mm=60.0)
        region.move(x_mm=5.0, over_s=0.1)
        region.change(opacity=0.5)
        region.set_value(0.25)
        assert region.remove().revision == 1
        named = h.layout.add(haptix.feel.materials.Button(), name="ok")
        assert (region.name, named.name) == ("region 1", "ok")
        with pytest.raises(
            haptix.service.client.connection.Refused, match="less than or equal to 1"
        ):
            region.set_value(2.0)
        with pytest.raises(haptix.service.client.connection.Refused, match="no job") as refused:
            h.watch("none")
        assert refused.value.code == "unknown"
    ops = [fields["ops"][0] for do, fields, _ in service.engine.told if do == "layout_change"]
    assert ops[:5] == [
        {"op": "add", "name": "region 1", "material": ribs, "x_mm": 1.0, "width_mm": 60.0},
        {"op": "move", "name": "region 1", "x_mm": 5.0, "over_s": 0.1},
        {"op": "change", "name": "region 1", "opacity": 0.5},
        {"op": "value", "name": "region 1", "value": 0.25},
        {"op": "remove", "name": "region 1"},
    ]
    assert ops[5]["material"]["kind"] == "button"


def test_a_material_is_felt_in_one_call_and_again_after_a_lost_connection(
    service, connect, monkeypatch, caplog
):
    """A virtual driver is armed; a real one only where a person asked."""
    ribs = haptix.feel.Grating(period_mm=2.0)
    region = haptix.service.feel(ribs)
    with region.session as h:
        assert h.lease.is_mine and h.output.state == "off"
        assert "real: call `arm`" in caplog.text
    monkeypatch.setattr(
        service.hub,
        "inventory",
        service.hub.inventory.model_copy(update={"screen_mm": (300.0, 200.0), "devices": ()}),
    )
    service.engine.told.clear()
    with haptix.service.feel(ribs, "kiosk").session as h:
        assert h.output.state == "armed"
        h.intensity(0.5)
        h.mute()
        monkeypatch.setattr(service.hub.control, "keep", lambda until_s: new_start(service))
        cut(service, h)
        assert h.lease.is_mine and h.output.state == "armed"
        assert h.output.intensity == 0.5 and h.output.muted
        shown = [fields for do, fields, _ in service.engine.told if do == "layout_set"]
        assert len(shown) == 2 and shown[0]["document"] == shown[1]["document"]
        (region,) = shown[0]["document"]["regions"]
        assert (region["width_mm"], region["height_mm"]) == (300.0, 200.0)
        assert region["material"]["kind"] == "grating"
    with connect("asked") as h:
        assert h.feel({"kind": "noise"}, person_asked=True).name == "felt"
        assert h.output.state == "armed"


def new_start(service):
    """Forget the holder and its layout, as a service that is begun anew."""
    service.hub.control.holder = None
    service.hub.control.disarm("a new start")


def cut(service, h):
    """Cut the connection, and wait until the client has another."""
    resumed = []
    ends = h.on("resumed", resumed.append)
    service.hub.sessions[h.welcome.session].close(1012, "cut")
    wait_for(lambda: resumed)
    ends()


def test_a_lost_connection_changes_nothing_that_is_felt_and_arms_nothing_that_was_not(
    service, connect, monkeypatch
):
    virtual = service.hub.inventory.model_copy(update={"devices": ()})
    monkeypatch.setattr(service.hub, "inventory", virtual)

    with connect("test") as h:
        region = h.feel({"kind": "grating", "period_mm": 2.0})
        region.change(material={"kind": "grating", "period_mm": 7.0})
        h.layout.add({"kind": "button"}, name="ok")
        cut(service, h)
        assert h.output.state == "armed"
        service.engine.told.clear()
        h.layout.add({"kind": "button"}, name="cancel")  # "ok" is still there
        h.ask("layout_change", ops=[{"op": "remove", "name": "ok"}])
        assert not [do for do, *_ in service.engine.told if do == "layout_set"]

        h.stop()
        cut(service, h)
        assert h.output.state == "off" and h.lease.is_mine
        h.arm()
        h.release()
        cut(service, h)
        assert h.output.state == "off" and not h.lease.is_mine

        h.feel({"kind": "noise"})
        h.layout_set({"regions": []})
        monkeypatch.setattr(service.hub.control, "keep", lambda until_s: new_start(service))
        cut(service, h)
        assert h.output.state == "off"


def test_streams_that_were_asked_for_one_by_one_are_all_asked_for_again(service, connect):
    with connect("test") as h:
        resumed = []
        h.on("resumed", resumed.append)
        h.ask("subscribe", streams={"stats": 10.0})
        h.ask("subscribe", streams={"friction": 100.0})
        service.hub.sessions[h.welcome.session].close(1012, "cut")
        wait_for(lambda: resumed)
        (session,) = service.hub.sessions.values()
        assert session.streams == {"stats": 10.0, "friction": 100.0}


def test_a_flood_of_touches_does_not_bury_the_client_s_own_stop(service, connect):
    async def floods():
        async with await haptix.service.client.connection.connect_async("test") as h:
            h._batches = Limiter(1.0, h.now_s, 64)  # a rate that no machine is too slow for
            await h.acquire()
            await h.arm()
            flood = [asyncio.ensure_future(h.touch(float(number), 2.0)) for number in range(500)]
            await h.stop()
            sent = sum(one.done() for one in flood)
            for one in flood:
                one.cancel()
            await asyncio.gather(*flood, return_exceptions=True)
            return sent

    assert asyncio.run(floods()) <= 66  # 64 at once, and one for each second that a stop takes
    assert service.engine.when("stop")


def test_more_touches_than_a_batch_takes_are_sent_in_several(service, connect):
    with connect("test") as h:
        h.acquire()
        h.arm()
        now_s, most = h.now_s(), h.welcome.limits.batch_touches
        touches = [
            m.TouchMessage(t_s=now_s + i * 1e-6, touch_id=i % 2, kind="move", x_mm=i, y_mm=0.0)
            for i in range(most + 10)
        ]
        batches, send = [], h._client._send
        h._client._send = lambda data: (batches.append(data), send(data))[1]
        h.touches(touches)
        wait_for(lambda: len(batches) == 2)
        assert len(batches[0]) > 50 * len(batches[1])


def test_touches_that_wait_are_left_out_by_close(service, connect, caplog):
    h = connect("test")
    h.acquire()
    h.arm()
    h._client._batches = Limiter(0.1, h.now_s, 1)
    for i in range(50):
        h.touch(float(i), 2.0)
    h.close()
    del h
    gc.collect()
    assert "Task was destroyed" not in caplog.text


def test_who_is_refused_hears_why_and_is_not_sent_to_start_another_service(service, connect):
    others = [connect(f"app {i}") for i in range(16)]
    with pytest.raises(HaptixError, match="expected at most 16 sessions"):
        connect("one more")
    for one in others:
        one.close()
    where = f"://127.0.0.1:{service.port}/v1/session"
    with pytest.raises(HaptixError, match=r"address: expected ws://HOST:PORT"):
        haptix.service.connect("test", "http" + where, "token")
    with pytest.raises(HaptixError, match=r"refuses the connection: .*403"):
        haptix.service.connect("test", f"ws://127.0.0.1:{service.port}/v2", "token")


def test_numbers_of_numpy_are_numbers(service, connect):
    with connect("test") as h:
        h.layout.add({"kind": "noise"}, x_mm=np.int64(3), y_mm=np.float32(0.5))
        with pytest.raises(InputError, match=r"^layout_set: expected a material or .* got set"):
            h.layout_set({1, 2})
    (op,) = [told["ops"] for do, told, _ in service.engine.told if do == "layout_change"][-1]
    assert (op["x_mm"], op["y_mm"]) == (3.0, 0.5)


def test_what_no_json_can_say_is_refused_before_it_is_sent(service, connect):
    with connect("test") as h:
        h.acquire()
        told = len(service.engine.told)
        with pytest.raises(InputError, match="finite"):
            h.play({"kind": "transient", "width_s": float("nan")})
        assert len(service.engine.told) == told
        assert h.arm().state == "armed"


def test_files_effects_streams_mute_and_pause_have_their_calls(service, connect, tmp_path):
    with connect("test") as h:
        path = tmp_path / "a.CSV"
        path.write_bytes(b"x,y\n" * 5_000_000)  # more than sockets hold
        name = h.asset(path)
        assert service.folder.joinpath("assets", f"{name.removeprefix('sha256:')}.csv").is_file()
        assert h.asset(path) == name  # it is there already
        (tmp_path / "notes.txt").write_bytes(path.read_bytes())
        with pytest.raises(haptix.service.client.connection.Refused, match="expected one of"):
            h.asset(tmp_path / "notes.txt")
        with (tmp_path / "large.jpg").open("wb") as large:
            large.truncate(h.welcome.limits.asset_bytes + 1)
        with pytest.raises(
            haptix.service.client.connection.Refused, match=r"large.jpg has 33554433 bytes"
        ):
            h.asset(tmp_path / "large.jpg")
        h.acquire(takeover=True)  # from the client of a test before
        h.arm()
        assert h.mute(True).muted and h.pause(True).paused
        assert not h.mute(False).muted
        playing = h.play({"kind": "transient"})
        h.cancel(playing.effect_id)
        assert h.subscribe({"stats": 10.0}).columns["stats"]
