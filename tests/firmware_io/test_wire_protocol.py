"""The wire format: golden frames, round trips, damage, HID reports."""

import json
import math
import re
import struct
import zlib
from binascii import crc_hqx
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import firmware_io
from firmware_io import LimitError, ProtocolError
from firmware_io.protocol import (
    REPORT_BYTES,
    STREAM_OVERHEAD_BYTES,
    Arm,
    CapabilitiesReport,
    DeviceState,
    FaultCode,
    FaultReport,
    Frame,
    FrameParser,
    Hello,
    Mark,
    MarkedReport,
    Ping,
    Rate,
    Revise,
    SenseReading,
    SenseReport,
    Setup,
    StatusReport,
    Stop,
    StreamMode,
    StreamSamples,
    TouchPhase,
    TouchReport,
    codes_to_volts,
    decode,
    encode,
    from_report,
    samples_per_frame,
    to_reports,
    volts_to_codes,
)
from tests.devices.guest import descriptors

# What a busy machine does to the time of one example says nothing about the code.
unhurried = settings(deadline=None)

ROOM = Path(firmware_io.__file__).parent
DOCUMENT = (ROOM / "PROTOCOL.md").read_text()
GOLDEN = json.loads((ROOM / "golden/frames.json").read_text())
CRCS = json.loads((ROOM / "golden/crc.json").read_text())

STREAM = Frame(StreamSamples(480, np.array([0, 1, -1, 32767, -32767], np.int16)), 7)

u16, u32, u64 = (st.integers(0, 2**bits - 1) for bits in (16, 32, 64))
i32 = st.integers(-(2**31), 2**31 - 1)
texts = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=16)
modes = st.sampled_from(StreamMode)
rates = st.builds(Rate, u32, st.frozensets(modes, min_size=1))
messages = st.one_of(
    st.builds(Hello, st.integers(0, 255), st.integers(0, 255)),
    st.builds(Setup, modes, u16, u32, u32, u32, u32, u32, u32, u16),
    st.builds(Arm),
    st.builds(Stop),
    st.builds(Ping, u32),
    st.builds(StreamSamples, u32, arrays(np.int16, st.integers(1, 300)), modes),
    st.builds(Revise, u32, arrays(np.int16, st.integers(1, 300)), modes, u16),
    st.builds(
        CapabilitiesReport,
        *(st.integers(0, 255), st.integers(0, 255), u16, u32, u32, u32, u32, u32, u16, u16),
        *(texts, texts, texts, st.booleans()),
        st.lists(rates, min_size=1, max_size=8).map(tuple),
        u32,
        *(st.booleans(), st.booleans(), st.integers(0, 3)),
        st.sampled_from([0, 250, 500, 1000, 2000, 4000]),
    ),
    st.builds(
        StatusReport,
        *(st.sampled_from(DeviceState), st.sampled_from(FaultCode), u16),
        *(u32, u32, u32, u32, u32, u32, u64, u16, u16, st.integers(-(2**31), 2**31 - 1)),
    ),
    st.builds(FaultReport, st.sampled_from(FaultCode), st.integers(0, 255), u16, u32, u32, u64),
    st.builds(TouchReport, u64, u32, u32, u16, st.integers(0, 255), st.sampled_from(TouchPhase)),
    st.builds(
        SenseReport,
        st.lists(
            st.builds(SenseReading, u64, i32, i32, st.integers(-(2**15), 2**15 - 1), u16),
            min_size=1,
            max_size=8,
        ).map(tuple),
    ),
)
frames = st.builds(Frame, messages, u16)


def with_byte(position: int, value: int, frame: Frame = STREAM) -> bytes:
    """A frame with one byte changed and both check sums made right again."""
    body = bytearray(encode(frame)[:-4])
    body[position] = value
    body[10:12] = struct.pack("<H", crc_hqx(bytes(body[:10]), 0xFFFF))
    return bytes(body) + struct.pack("<I", zlib.crc32(body))


def from_golden(golden):
    """The frame that a golden one stands for, made from its fields."""
    values = dict(golden["fields"])
    if golden["kind"] in ("STREAM", "REVISE"):
        kind = StreamSamples if golden["kind"] == "STREAM" else Revise
        values["codes"] = np.array(values["codes"], np.int16)
        message = kind(**values | {"mode": StreamMode(values["mode"])})
    else:
        kinds = {
            "HELLO": Hello,
            "SETUP": Setup,
            "ARM": Arm,
            "STOP": Stop,
            "PING": Ping,
            "CAPABILITIES": CapabilitiesReport,
            "STATUS": StatusReport,
            "FAULT": FaultReport,
            "TOUCH": TouchReport,
            "MARK": Mark,
            "MARKED": MarkedReport,
            "SENSE": SenseReport,
        }
        enums = {
            "mode": StreamMode,
            "state": DeviceState,
            "fault": FaultCode,
            **({"code": FaultCode} if golden["kind"] == "FAULT" else {}),
            "phase": TouchPhase,
        }
        for name in enums.keys() & values.keys():
            values[name] = enums[name](values[name])
        if "rates" in values:
            values["rates"] = tuple(
                Rate(r, frozenset(map(StreamMode, m))) for r, m in values["rates"]
            )
        if "readings" in values:
            values["readings"] = tuple(SenseReading(*row) for row in values["readings"])
        message = kinds[golden["kind"]](**values)
    return Frame(message, golden["sequence"])


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda g: g["kind"])
def test_golden_frames(golden):
    data = bytes.fromhex(golden["bytes"])
    frame = from_golden(golden)
    assert encode(frame) == data
    assert decode(data) == frame


def test_there_is_a_golden_frame_of_each_kind():
    kinds = set(re.findall(r"\*\*([A-Z]+), 0x", DOCUMENT))
    assert kinds == {g["kind"] for g in GOLDEN}


@pytest.mark.parametrize("golden", CRCS, ids=lambda g: g["bytes"][:12])
def test_golden_check_sums(golden):
    # 29b1 and cbf43926 are the published check values of "123456789" (CRC-16/IBM-3740, CRC-32).
    data = bytes.fromhex(golden["bytes"])
    assert f"{crc_hqx(data, 0xFFFF):04x}" == golden["crc16"]
    assert f"{zlib.crc32(data):08x}" == golden["crc32"]
    if data == b"123456789":
        assert (golden["crc16"], golden["crc32"]) == ("29b1", "cbf43926")


def test_document_shows_the_golden_stream():
    assert re.sub(r"\s+", "", encode(STREAM).hex()) in re.sub(r"\s+", "", DOCUMENT)


@pytest.mark.parametrize("message", [Setup, StatusReport, FaultReport, TouchReport])
def test_document_lists_the_fields(message):
    # The document writes clock_ticks as "clock" and field_offset as "field".
    for field in fields(message):
        assert f"| {field.name.removesuffix('_ticks').removesuffix('_offset')} |" in DOCUMENT


def test_document_has_the_report_descriptor_of_the_emulated_board():
    """63 bytes each way behind an id of one byte: what the device tests plug into a real host."""
    assert descriptors.HID_REPORT.hex() in re.sub(r"\s+", "", DOCUMENT)
    count = descriptors.HID_REPORT[descriptors.HID_REPORT.index(0x95) + 1]
    assert count + 1 == REPORT_BYTES


def test_document_lists_the_faults():
    listed = re.findall(r"^\| (\d+) \| ([A-Z_]+)", DOCUMENT, re.MULTILINE)
    assert [(int(c), n) for c, n in listed if n in FaultCode.__members__] == [
        (code.value, code.name) for code in FaultCode if code
    ]


@unhurried
@given(frames)
def test_round_trip(frame):
    assert decode(encode(frame)) == frame


def test_every_single_bit_flip_is_rejected():
    data = encode(STREAM)
    for bit in range(8 * len(data)):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        with pytest.raises(ProtocolError):
            decode(bytes(damaged))


def test_every_truncation_and_extension_is_rejected():
    data = encode(STREAM)
    for length in range(len(data)):
        with pytest.raises(ProtocolError):
            decode(data[:length])
    with pytest.raises(ProtocolError, match=r"30 .*31"):
        decode(data + b"\0")


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"HX", "at least 16 bytes, but 2 came"),
        (with_byte(0, 0x41), "begins with b'HX', but b'AX' came"),
        (with_byte(2, 5), "version 4, but version 5 came"),
        (with_byte(2, 255), "version 4, but version 255 came"),
        (with_byte(3, 9), "no kind 0x09"),
        (with_byte(3, 1), "HELLO frame cannot be read"),
        (with_byte(6, 16), "payload of 16 bytes has 32 bytes, but 30 came"),
        (with_byte(8, 7), "stream mode is one of 0, 1, but 7 came"),
        (with_byte(8, 1, Frame(Arm(), 0)), "Only STREAM and REVISE have a mode, but mode 1 came"),
        (encode(STREAM)[:-1] + b"\0", "CRC-32"),
        (encode(STREAM)[:4] + b"\x08" + encode(STREAM)[5:], "CRC-16"),
    ],
)
def test_each_defect_has_its_own_sentence(data, sentence):
    with pytest.raises(ProtocolError, match=re.escape(sentence)):
        decode(data)


def test_a_stream_without_samples_is_refused():
    body = bytearray(encode(STREAM)[:10])
    body[6] = 4
    body += struct.pack("<H", crc_hqx(bytes(body), 0xFFFF)) + bytes(4)
    with pytest.raises(ProtocolError, match="one sample"):
        decode(bytes(body) + struct.pack("<I", zlib.crc32(body)))


RATE = Rate(48000, frozenset(StreamMode))
capabilities: Callable[..., CapabilitiesReport] = CapabilitiesReport


@pytest.mark.parametrize(
    "make",
    [
        lambda: encode(Frame(StreamSamples(0, np.zeros(1)), 0)),
        lambda: encode(Frame(StreamSamples(0, np.zeros((1, 1), np.int16)), 0)),
        lambda: encode(Frame(StreamSamples(0, np.zeros(0, np.int16)), 0)),
        lambda: encode(Frame(StreamSamples(0, np.zeros(32766, np.int16)), 0)),
        lambda: encode(Frame(StreamSamples(2**32, np.zeros(1, np.int16)), 0)),
        lambda: encode(Frame(StreamSamples(-1, np.zeros(1, np.int16)), 0)),
        lambda: encode(Frame(Arm(), 2**16)),
        lambda: encode(Frame(Ping(-1), 0)),
        lambda: encode(Frame(Hello(2, 256), 0)),
        lambda: encode(Frame(capabilities(*[2] * 10, "x" * 17, "", "", False, (RATE,)), 0)),
        lambda: encode(Frame(capabilities(*[2] * 10, "ü", "", "", False, (RATE,)), 0)),
        lambda: encode(Frame(capabilities(*[2] * 10, "", "", "", False, ()), 0)),
    ],
)
def test_what_does_not_fit_the_wire_is_refused(make):
    with pytest.raises(ProtocolError):
        make()


def test_the_longest_stream_fits():
    frame = Frame(StreamSamples(0, np.full(32765, -5, np.int16)), 0)
    assert len(encode(frame)) == 2 * 32765 + STREAM_OVERHEAD_BYTES
    assert decode(encode(frame)) == frame


# Out of a stream of bytes


@unhurried
@given(st.lists(frames, max_size=5), st.data())
def test_the_pieces_do_not_matter(sent, data):
    wire = b"".join(map(encode, sent))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(wire)), max_size=8)))
    parser = FrameParser()
    found = []
    for start, end in zip([0, *cuts], [*cuts, len(wire)], strict=True):
        found += parser.feed(wire[start:end])
    assert found == sent
    assert parser.skipped_bytes == 0
    assert not parser.is_amid_a_frame


@unhurried
@given(st.binary(max_size=200), st.lists(frames, min_size=1, max_size=4))
def test_garbage_costs_no_frame_behind_it(garbage, sent):
    # A header cannot come about by chance (32 bits must agree), so nothing behind is swallowed.
    parser = FrameParser()
    found = parser.feed(garbage + b"".join(map(encode, sent)))
    assert [item for item in found if isinstance(item, Frame)] == sent
    assert parser.skipped_bytes == len(garbage)


@unhurried
@given(arrays(np.int16, 100), st.integers(1, 219), st.integers(0, 2**16 - 1))
def test_a_frame_cut_short_delays_at_most_one(codes, length, sequence):
    frame = encode(Frame(StreamSamples(0, codes), sequence))
    parser = FrameParser()
    found = parser.feed(frame[:length]) + parser.feed(frame) + parser.feed(frame)
    assert [item for item in found if isinstance(item, Frame)] == [decode(frame)] * 2


@unhurried
@given(frames, st.data())
def test_a_damaged_frame_is_told_once_and_the_next_one_is_found(frame, data):
    wire = bytearray(encode(frame))
    bit = data.draw(st.integers(0, 8 * len(wire) - 1))
    wire[bit // 8] ^= 1 << bit % 8
    parser = FrameParser()
    found = parser.feed(bytes(wire) + 2 * encode(STREAM))
    assert [item for item in found if isinstance(item, Frame)] == [STREAM, STREAM]
    assert sum(isinstance(item, ProtocolError) for item in found) == 1
    assert parser.skipped_bytes == len(wire)


def test_a_frame_from_the_future_is_refused_by_name():
    found = FrameParser().feed(with_byte(2, 5) + encode(STREAM))
    assert "version 4, but version 5 came" in str(found[0])
    assert found[1:] == [STREAM]


def test_a_length_beyond_the_receivers_is_not_believed():
    long = encode(Frame(StreamSamples(0, np.zeros(400, np.int16)), 1))
    parser = FrameParser(max_payload_bytes=64)
    found = parser.feed(long[:20] + encode(STREAM))
    assert "at most 64 bytes" in str(found[0])
    assert found[1:] == [STREAM]


def test_giving_up_a_frame_that_broke_off_finds_those_behind_it():
    long = encode(Frame(StreamSamples(0, np.zeros(400, np.int16)), 1))
    parser = FrameParser()
    assert parser.feed(long[:100] + encode(STREAM)) == []
    assert parser.is_amid_a_frame
    found = parser.give_up()
    assert "broke off" in str(found[0])
    assert found[1:] == [STREAM]
    assert not parser.is_amid_a_frame
    assert parser.give_up() == []


# In reports


@unhurried
@given(frames, st.integers(8, 64))
def test_reports_carry_the_bytes(frame, report_bytes):
    data = encode(frame)
    reports = to_reports(data, report_bytes)
    pieces = [from_report(report) for report in reports]
    assert {len(report) for report in reports} == {report_bytes}
    assert b"".join(piece for piece, _ in pieces) == data
    assert [begins for _, begins in pieces] == [True] + [False] * (len(reports) - 1)


@pytest.mark.parametrize("report", [b"", b"\1", b"\2\5hello", b"\1\6hello"])
def test_a_report_of_another_device_is_refused(report):
    with pytest.raises(ProtocolError):
        from_report(report)


def overhead_share(samples):
    """Share of the bytes of reports that carry no sample."""
    reports = to_reports(encode(Frame(StreamSamples(0, np.zeros(samples, np.int16)), 0)))
    return 1 - 2 * samples / sum(map(len, reports))


@pytest.mark.parametrize("reports", [1, 2, 3, 4, 6])
def test_document_states_the_overhead(reports):
    samples = samples_per_frame(reports)
    share = overhead_share(samples)
    row = f"| {reports} | {samples} | {samples / 16:.1f} | {100 * share:.1f} % |"
    assert row in DOCUMENT
    assert (
        len(to_reports(encode(Frame(StreamSamples(0, np.zeros(samples, np.int16)), 0)))) == reports
    )
    assert (
        len(to_reports(encode(Frame(StreamSamples(0, np.zeros(samples + 1, np.int16)), 0))))
        > reports
    )


def test_overhead_on_hid_is_under_15_per_cent():
    # 16 kHz envelope in frames of three reports: 5.2 ms each.
    assert overhead_share(samples_per_frame(3, REPORT_BYTES)) < 0.15
    reports_per_s = 3 * 16_000 / samples_per_frame(3)
    assert reports_per_s < 1000  # what a full-speed interrupt endpoint takes


# Faults for people


@pytest.mark.parametrize("code", [code for code in FaultCode if code])
def test_each_fault_has_a_sentence(code):
    sentence = str(FaultReport(code, 12, 3, 180_000, 4, 5))
    assert sentence.endswith(".")
    assert "{" not in sentence


def test_fault_sentences_carry_the_numbers():
    assert "ceiling_mv of 7 is refused, the bound is 5" in str(
        FaultReport(FaultCode.SETUP, 12, 0, 5, 7, 0)
    )
    assert "180.007 V is above the ceiling of 180 V" in str(
        FaultReport(FaultCode.CEILING, 0, 0, 180_000, 180_007, 0)
    )
    assert str(FaultReport(FaultCode.ALREADY_ARMED, 0, 0, 0, 3, 0)) == "ARM came while armed."


# Codes


def test_codes_by_hand():
    # 1/3 of 32767 is 10922.33; 100/250 of it is 13106.8.
    volts = [0.0, 250.0, -250.0, 250 / 3, 100.0, -100.0]
    np.testing.assert_array_equal(
        volts_to_codes(volts, 250.0), [0, 32767, -32767, 10922, 13107, -13107]
    )


@unhurried
@given(
    st.floats(1.0, 1000.0).flatmap(
        lambda full: st.tuples(
            st.just(full), arrays(np.float64, 20, elements=st.floats(-full, full))
        )
    )
)
def test_quantisation_is_within_half_a_step(case):
    full_scale_v, volts = case
    back = codes_to_volts(volts_to_codes(volts, full_scale_v), full_scale_v)
    # Half a step is what nearest means; 1e-9 of it allows for rounding in float64.
    assert np.abs(back - volts).max() <= full_scale_v / 32767 / 2 * (1 + 1e-9)
    assert np.abs(back).max() <= full_scale_v


@unhurried
@given(st.integers(-32767, 32767), st.floats(1.0, 1000.0))
def test_codes_survive_the_way_through_volts(code, full_scale_v):
    volts = codes_to_volts(np.array([code], np.int16), full_scale_v)
    assert volts_to_codes(volts, full_scale_v)[0] == code


@pytest.mark.parametrize("volts", [250.00001, -250.00001, np.nan, np.inf])
def test_beyond_full_scale_is_rejected_not_clipped(volts):
    with pytest.raises(LimitError, match="Sample 1"):
        volts_to_codes([0.0, volts], 250.0)


@unhurried
@given(st.floats(1.0, 250.0), st.floats(250.0, 1000.0))
def test_no_code_stands_for_more_than_the_ceiling(ceiling_v, full_scale_v):
    volts = np.array([ceiling_v, -ceiling_v])
    back = codes_to_volts(volts_to_codes(volts, full_scale_v, ceiling_v), full_scale_v)
    assert np.abs(back).max() <= ceiling_v
    # Rounding toward zero at the ceiling costs less than one step (1e-9: float64 rounding).
    assert np.abs(back - volts).max() <= full_scale_v / 32767 * (1 + 1e-9)


@pytest.mark.parametrize("code", [65, 129, 26214])
def test_a_ceiling_one_rounding_below_a_code_excludes_it(code):
    ceiling_v = math.nextafter(code / 32767 * 250.0, 0.0)
    assert volts_to_codes([ceiling_v], 250.0, ceiling_v)[0] == code - 1
