"""The wire format: round trips, damage, and one frame written out by hand."""

import math
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import firmware_io
from firmware_io import (
    Frame,
    FrameKind,
    LimitError,
    ProtocolError,
    codes_to_volts,
    decode,
    encode,
    volts_to_codes,
)

GOLDEN = Frame(FrameKind.STREAM, 7, 480, np.array([0, 1, -1, 32767, -32767], np.int16))
GOLDEN_HEX = (
    "48 58 01 02 07 00 00 00 e0 01 00 00 00 00 00 00 05 00 00 00"  # header
    " 00 00 01 00 ff ff ff 7f 01 80"  # codes, two's complement
    " 2f fa 3c fb"  # CRC-32
)

frames = st.builds(
    lambda sequence, index, samples: Frame(FrameKind.STREAM, sequence, index, samples),
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**64 - 1),
    arrays(np.int16, st.integers(0, 300)),
)


def with_byte(position: int, value: int) -> bytes:
    """The golden frame with one header byte changed and the CRC made right again."""
    body = bytearray(encode(GOLDEN)[:-4])
    body[position] = value
    return bytes(body) + struct.pack("<I", zlib.crc32(body))


def bitwise_crc32(data: bytes) -> int:
    """CRC-32 from its definition (reflected polynomial 0xEDB88320), independent of zlib."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


def test_golden_frame():
    assert encode(GOLDEN) == bytes.fromhex(GOLDEN_HEX)


def test_golden_crc_follows_the_definition():
    data = bytes.fromhex(GOLDEN_HEX)
    assert bitwise_crc32(data[:-4]) == int.from_bytes(data[-4:], "little") == 0xFB3CFA2F


def test_document_shows_the_golden_frame():
    text = (Path(firmware_io.__file__).parent / "PROTOCOL.md").read_text()
    assert re.sub(r"\s+", "", GOLDEN_HEX) in re.sub(r"\s+", "", text)


@given(frames)
def test_round_trip(frame):
    back = decode(encode(frame))
    assert back.kind is FrameKind.STREAM
    assert (back.sequence, back.sample_index) == (frame.sequence, frame.sample_index)
    assert back.samples.dtype == np.int16
    np.testing.assert_array_equal(back.samples, frame.samples)


@pytest.mark.parametrize("kind", [FrameKind.ARM, FrameKind.STOP])
def test_round_trip_without_samples(kind):
    data = encode(Frame(kind, 1, 2))
    assert len(data) == 24
    assert decode(data).kind is kind


def test_every_single_bit_flip_is_rejected():
    data = encode(GOLDEN)
    for bit in range(8 * len(data)):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        with pytest.raises(ProtocolError):
            decode(bytes(damaged))


def test_every_truncation_and_extension_is_rejected():
    data = encode(GOLDEN)
    for length in range(len(data)):
        with pytest.raises(ProtocolError):
            decode(data[:length])
    with pytest.raises(ProtocolError, match="34 bytes, but 35 came"):
        decode(data + b"\0")


@given(st.binary(max_size=80) | st.binary(max_size=60).map(lambda tail: b"HX\x01" + tail))
def test_random_bytes_raise_nothing_but_protocol_error(data):
    with pytest.raises(ProtocolError):
        decode(data)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"HX", "at least 24 bytes, but 2 came"),
        (with_byte(0, 0x41), "begins with b'HX', but b'AX' came"),
        (with_byte(2, 2), "version 1, but version 2 came"),
        (with_byte(3, 9), "kind 9 came"),
        (with_byte(3, 1), "Only STREAM frames carry samples"),
        (with_byte(16, 6), "6 samples has 36 bytes, but 34 came"),
        (with_byte(18, 1), "mode 1 came"),
        (with_byte(19, 255), "reserved byte must be 0, but is 255"),
        (encode(GOLDEN)[:-1] + b"\0", "CRC-32"),
    ],
)
def test_each_defect_has_its_own_sentence(data, sentence):
    with pytest.raises(ProtocolError, match=re.escape(sentence)):
        decode(data)


@pytest.mark.parametrize(
    "fields",
    [
        (2**32, 0, np.zeros(1, np.int16)),
        (-1, 0, np.zeros(1, np.int16)),
        (0, 2**64, np.zeros(1, np.int16)),
        (0, 0, np.zeros(1)),
        (0, 0, np.zeros((1, 1), np.int16)),
        (0, 0, np.zeros(65536, np.int16)),
    ],
)
def test_a_frame_that_does_not_fit_the_wire_is_refused(fields):
    with pytest.raises(ProtocolError):
        Frame(FrameKind.STREAM, *fields)


def test_codes_by_hand():
    # 1/3 of 32767 is 10922.33; 100/250 of it is 13106.8.
    volts = [0.0, 250.0, -250.0, 250 / 3, 100.0, -100.0]
    np.testing.assert_array_equal(
        volts_to_codes(volts, 250.0), [0, 32767, -32767, 10922, 13107, -13107]
    )


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


@given(st.integers(-32767, 32767), st.floats(1.0, 1000.0))
def test_codes_survive_the_way_through_volts(code, full_scale_v):
    volts = codes_to_volts(np.array([code], np.int16), full_scale_v)
    assert volts_to_codes(volts, full_scale_v)[0] == code


@pytest.mark.parametrize("volts", [250.00001, -250.00001, np.nan, np.inf])
def test_beyond_full_scale_is_rejected_not_clipped(volts):
    with pytest.raises(LimitError, match="Sample 1"):
        volts_to_codes([0.0, volts], 250.0)


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
