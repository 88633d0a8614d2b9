"""The golden sessions hold against the real front, so that clients can be written by them."""

import json
from math import nan

import numpy as np
import pytest

from haptix.service.protocol.batches import read_frame, read_touches
from tests.clients.golden import SESSIONS, Run, lines, written


@pytest.mark.parametrize("name", SESSIONS)
def test_session(service, name):
    Run(service.port, service.access.native).play(name)


@pytest.mark.parametrize("line", lines("bytes"), ids=json.dumps)
def test_bytes(line):
    data = bytes.fromhex(line["hex"])
    if "frame" in line:
        frame, expected = read_frame(data)._asdict(), line["frame"]
        rows = [[nan if value is None else value for value in row] for row in expected["rows"]]
        shape = (len(rows), expected.pop("columns"))
        np.testing.assert_array_equal(
            frame.pop("rows"), np.asarray(rows, dtype=np.float32).reshape(shape)
        )
        del expected["rows"]
        assert frame == expected
        return
    assert read_touches(data).number == line["number"]
    bytes_, coalesced = written(line)
    for index, flag in enumerate(coalesced):  # only clients in pages send it
        bytes_[16 + 24 * index + 5] |= 32 * flag
    assert bytes_ == data
