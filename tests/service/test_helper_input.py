"""Helpers end with the front: what they compute then does not keep them."""

import subprocess
import sys

import pytest

from haptix.service.wire import json_frame
from tests.waiting import PATIENCE_S

BUSY = """
from haptix.service.helper_input import frames
for _, data in frames(last_s=0.1):
    print(data.decode(), flush=True)
    while True:
        pass
"""


def test_a_helper_that_computes_ends_when_its_input_does():
    with subprocess.Popen(
        [sys.executable, "-c", BUSY], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        process.stdin.write(json_frame({"do": "compute"}))
        process.stdin.flush()
        assert b"compute" in process.stdout.readline()
        assert process.poll() is None
        process.stdin.close()
        assert process.wait(PATIENCE_S) == 1


@pytest.mark.parametrize("module", ["making", "job_work"])
def test_a_helper_whose_front_has_gone_says_nothing(module):
    """Both pipes close, as when the front is killed while an answer is on its way."""
    with subprocess.Popen(
        [sys.executable, "-m", f"haptix.service.{module}"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        process.stdout.close()
        context = {"finger": "semi-wet", "screen": "3m-sct3250", "assets": "."}
        asked = {"n": 1, "do": "experiment", "recipe": {"folder": "."}, "log": "x"}
        process.stdin.write(json_frame({**asked, "context": context}))
        process.stdin.close()
        said = process.stderr.read()
        process.wait(PATIENCE_S)
        assert b"BrokenPipe" not in said
