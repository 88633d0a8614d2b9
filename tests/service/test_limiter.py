"""The rate limiter: what may be taken at once, and afterwards; and that REST has one, too."""

from http.client import HTTPConnection

from haptix.service.front import application as front
from haptix.service.protocol.limiter import Limiter
from tests.hand_clock import HandClock
from tests.service.service_under_test import Service
from tests.waiting import PATIENCE_S


def test_a_second_s_worth_at_once_and_then_the_rate():
    clock = HandClock()
    limiter = Limiter(8.0, clock)
    assert [limiter.wait_s() for _ in range(8)] == [0.0] * 8
    assert limiter.wait_s(2) == 0.25
    clock.sleep(0.375)  # two were taken ahead, one is there
    assert limiter.wait_s() == 0.0
    assert limiter.wait_s() == 0.125
    clock.sleep(60.0)  # no more than a second's worth is saved
    assert limiter.wait_s(9) == 0.125


def test_what_is_refused_takes_nothing():
    clock = HandClock()
    limiter = Limiter(0.5, clock, 2)
    assert [limiter.takes() for _ in range(4)] == [True, True, False, False]
    clock.sleep(2.0)
    assert [limiter.takes() for _ in range(2)] == [True, False]


def test_requests_of_one_owner_have_a_limit_together(tmp_path, monkeypatch):
    made = []

    class Counting(Limiter):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            self.taken = 0
            made.append(self)

        def wait_s(self, count=1):
            self.taken += count
            return 0.0

    monkeypatch.setattr(front, "Limiter", Counting)
    service = Service(tmp_path)
    try:
        pages = [None, "https://a.example", "https://b.example"]
        for page in pages:
            token = service.access.native
            if page is not None:
                token = service.access.pair(service.access.code(), page, "page")
            headers = {"Authorization": f"Bearer {token}"} | ({"Origin": page} if page else {})
            for _ in range(3):
                connection = HTTPConnection("127.0.0.1", service.port, timeout=PATIENCE_S)
                connection.request("GET", "/v1/server", headers=headers)
                assert connection.getresponse().status == 200
    finally:
        service.close()
    assert [one.taken for one in made] == [3] * len(pages)
