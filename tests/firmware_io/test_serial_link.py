"""The serial link on a pseudo-terminal, with haptix's own firmware behind it."""

import os

import pytest

pytest.importorskip("serial", reason="the extra serial is not installed")
pytest.importorskip("termios", reason="this system has no pseudo-terminals")

import serial

from firmware_io import ProtocolError, open_device
from firmware_io.links.serial import SerialLink
from firmware_io.proof_test import proof_test
from tests.serial_board import Board

ESP32 = b"ets Jul 29 2019 12:21:46\r\n\r\nrst:0x1 (POWERON_RESET),boot:0x13\r\n"


@pytest.fixture
def board_of(no_thread_is_left):
    boards = []

    def start(*arguments):
        boards.append(Board(*arguments))
        boards[-1].start()
        return boards[-1]

    yield start
    for board in boards:
        board.end.set()
        board.join()
        os.close(board.controller)


@pytest.mark.parametrize(
    ("deaf_s", "text"),
    [
        (0.0, b""),
        (0.4, b""),
        (0.7, ESP32),
        (0.7, b"HX" * 40),  # as if a frame began
        pytest.param(2.9, ESP32, marks=pytest.mark.slow),
    ],
)
def test_a_board_that_resets_on_opening_opens(board_of, deaf_s, text):
    board = board_of(deaf_s, text)
    with open_device(f"serial:port={board.port}") as device:
        device.write([10.0] * 100)
        assert device.capabilities.serial
    device.close()


@pytest.mark.slow
def test_the_proof_test_waits_for_such_a_board_too(board_of):
    link = SerialLink(board_of(0.7, ESP32).port)
    proofs = proof_test(link)
    link.close()
    assert proofs[0].holds


class Silent:
    """What is no driver."""

    def receive(self, data):
        """Take no notice."""

    def transmit(self):
        return b""


def test_what_never_answers_is_told_apart(board_of, monkeypatch):
    monkeypatch.setattr(SerialLink, "wakes_s", 0.0)
    with pytest.raises(ProtocolError, match=r"within 0\.5 s"):
        open_device(f"serial:port={board_of(0.0, b'', Silent).port}")
    with pytest.raises(ProtocolError, match="not as a haptix driver"):
        open_device(f"serial:port={board_of(0.0, ESP32, Silent).port}")


@pytest.mark.parametrize("line", ["dtr", "rts"])
@pytest.mark.parametrize(("option", "level"), [("=no", False), ("=yes", True), (None, True)])
def test_the_lines_that_reset_a_board_are_chosen(board_of, monkeypatch, line, option, level):
    seen = {}
    for name in ("dtr", "rts"):  # which a pseudo-terminal does not have
        monkeypatch.setattr(
            serial.Serial,
            f"_update_{name}_state",
            lambda port, name=name: seen.update({name: getattr(port, f"_{name}_state")}),
        )
    address = f"serial:port={board_of(0.0).port}"
    open_device(address if option is None else f"{address},{line}{option}").close()
    assert seen == {"dtr": True, "rts": True, line: level}
