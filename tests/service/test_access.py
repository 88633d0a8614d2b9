"""Tokens, codes, hosts and origins."""

import json

import pytest

from haptix.service.front.access import CODE_S, Access
from haptix.service.protocol.messages import Problem
from tests.hand_clock import HandClock

PAGE = "https://example.org"


@pytest.fixture
def clock():
    return HandClock()


@pytest.fixture
def access(tmp_path, clock):
    return Access(7421, tmp_path / "service", now_s=clock)


@pytest.mark.parametrize(
    "host", ["127.0.0.1:7421", "localhost:7421", "LOCALHOST:7421", "[::1]:7421"]
)
def test_own_names(access, host):
    assert access.is_own_host(host)


@pytest.mark.parametrize(
    "host",
    [
        *(
            None,
            "",
            "localhost",
            "127.0.0.1:80",
            "evil.example:7421",
            "localhost.evil.example:7421",
        ),
        *("127.0.0.1:7421.evil.example", "[::1]"),
    ],
)
def test_rebound_names(access, host):
    assert not access.is_own_host(host)


def test_a_page_is_paired_by_the_code_and_remembered(access, clock, tmp_path):
    assert not access.is_known_origin(PAGE)
    token = access.pair(access.code().lower(), PAGE, "a page")
    assert access.is_known_origin(PAGE) and access.lets_in(token, PAGE)
    assert not access.lets_in(token, None) and not access.lets_in(token, "https://other.example")
    again = Access(7421, tmp_path / "service", now_s=clock)
    assert again.lets_in(token, PAGE)
    again.forget(token)
    assert not again.lets_in(token, PAGE)
    kept = (tmp_path / "service" / "tokens.json").read_text()
    assert token not in kept  # only its hash


def test_an_own_page_reads_without_an_origin(access):
    """Browsers send none with a GET to the page's own origin, and one with all that others ask."""
    own = min(access.origins)
    token = access.pair(access.code(), own, "studio")
    assert access.lets_in(token, None) and access.lets_in(token, own)
    assert not access.lets_in(token, PAGE)


def test_a_code_is_good_once_and_for_five_minutes(access, clock):
    code = access.code()
    access.pair(code, PAGE, "a page")
    with pytest.raises(Problem):
        access.pair(code, PAGE, "again")
    code = access.code()
    clock.now_s += CODE_S + 1
    with pytest.raises(Problem):
        access.pair(code, PAGE, "late")


def test_codes_cannot_be_tried_out(access, clock):
    for _ in range(5):
        with pytest.raises(Problem, match="not the code"):
            access.pair("AAAAAAAA", PAGE, "a guess")
    with pytest.raises(Problem, match="tries a minute"):
        access.pair(access.code(), PAGE, "a guess")
    clock.now_s += 61
    assert access.pair(access.code(), PAGE, "a page")


OWN = "http://127.0.0.1:7421"


def test_a_page_that_guesses_keeps_nobody_out(access):
    """Neither the service's own page, nor another one, however many origins it makes up."""
    code = access.code()
    for number in range(1000):
        with pytest.raises(Problem):
            access.pair("AAAAAAAA", f"https://{number % 50}.example.com", "a guess")
    assert access.pair(code, PAGE, "a page")  # and none of those tries has spent the code
    for number in range(1000):
        with pytest.raises(Problem):
            access.pair("AAAAAAAA", f"https://{number}.example.com", "a guess")
    assert access.pair(access.code(), "https://one-more.example.com", "a page")
    assert OWN in access.origins and access.pair(access.code(), OWN, "studio")


def test_all_that_come_near_to_a_code_have_a_budget(access):
    near = access.code()[:4] + "AAAA"
    for number in range(600):
        with pytest.raises(Problem, match="not the code"):
            access.pair(near, f"https://{number}.example.com", "a guess")
    with pytest.raises(Problem, match="tries a minute"):
        access.pair(access.code(), PAGE, "a page")


def test_a_code_is_good_until_its_token_is_kept(access, monkeypatch):
    def full(self, name, content):
        raise OSError(28, "No space left on device")

    code = access.code()
    with monkeypatch.context() as patch:
        patch.setattr(Access, "_write", full)
        with pytest.raises(OSError, match="No space"):
            access.pair(code, PAGE, "a page")
    assert not access.is_known_origin(PAGE)
    token = access.pair(code, PAGE, "a page")
    assert access.lets_in(token, PAGE)


@pytest.mark.parametrize("origin", [None, "", "null"])
def test_only_pages_pair(access, origin):
    with pytest.raises(Problem, match="page"):
        access.pair(access.code(), origin, "no page")


def test_a_program_reads_its_token_where_no_other_user_can(access, tmp_path):
    path = tmp_path / "service" / "service.json"
    assert path.stat().st_mode & 0o077 == 0
    token = json.loads(path.read_text())["token"]
    assert access.lets_in(token, None)
    assert not access.lets_in(token, PAGE)  # a page that got hold of it is no program
    assert not access.lets_in("", None)
    access.close()
    assert not path.exists() and not access.lets_in(token, None)
