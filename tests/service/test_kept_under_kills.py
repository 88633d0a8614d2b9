"""Writers of kept layouts are killed at any moment: what was confirmed is there, and whole.

`HAPTIX_SEQUENCES=1000 pytest tests/service/test_kept_under_kills.py` tries that many. The same
sequences in Chromium, with pages and undo, are in `tests/studio/test_make.py`.
"""

import json
import os
import random
import signal
import time

import pytest

from haptix.service.front.rest import KeptTexts
from haptix.service.protocol.messages import Problem

SEQUENCES = int(os.environ.get("HAPTIX_SEQUENCES", "20"))


def write(folder, seed, confirmed):
    """Edit, undo, rename, remove and bring back at random; tell of each edit that was done."""
    chance, kept = random.Random(seed), KeptTexts(folder)
    texts, number = {}, 0
    for name in kept.names():
        texts[name] = kept.read(name)[0]
    while True:
        name = chance.choice(["a", "b", "c"])
        what = chance.choice(["edit", "edit", "edit", "undo", "rename", "remove", "stale"])
        revision = f'"{kept.read(name)[1]}"' if name in texts else None
        number += 1
        text = json.dumps({"seed": seed, "number": number, "name": name, "x": "x" * 3000})
        if what == "edit":
            kept.write(name, text, revision)
            texts[name] = text
        elif what == "undo" and name in texts and len(versions := kept.versions(name)) > 1:
            texts[name] = kept.read(name, versions[1].revision)[0]
            kept.write(name, texts[name], revision)
        elif what == "rename" and name in texts:
            to = next((one for one in "abc" if one not in texts), None)
            if to is None:
                continue
            kept.rename(name, to, revision)
            texts[to] = texts.pop(name)
        elif what == "remove" and name in texts and chance.random() < 0.3:
            kept.remove(name, revision)
            del texts[name]
        elif what == "stale" and name in texts:
            try:  # a second page, which has not seen the last edit
                kept.write(name, text, '"0"')
            except Problem:
                continue
            raise AssertionError("a stale write was taken")
        else:
            continue
        os.write(confirmed, (json.dumps([what, texts]) + "\n").encode())


def read_whole(confirmed):
    """The confirmed states; what was being told when the writer died is cut off."""
    with os.fdopen(confirmed) as lines:
        return [json.loads(line) for line in lines if line.endswith("\n")]


@pytest.mark.parametrize("part", range(10))
def test_no_confirmed_edit_is_lost_when_the_writer_is_killed(tmp_path, part):
    for seed in range(part, SEQUENCES, 10):
        folder = tmp_path / str(seed)
        for life in range(3):  # each goes on from what the one before has left
            reads, writes = os.pipe()
            writer = os.fork()
            if not writer:
                os.close(reads)
                try:
                    write(folder, 10 * seed + life, writes)
                finally:
                    os._exit(1)
            os.close(writes)
            time.sleep(random.Random(seed + life).uniform(0.0, 0.03))
            os.kill(writer, signal.SIGKILL)
            told = read_whole(reads)
            status = os.waitpid(writer, 0)[1]
            assert os.WTERMSIG(status) == signal.SIGKILL, "the writer ended by itself"
            kept = KeptTexts(folder)
            now = {name: kept.read(name)[0] for name in kept.names()}
            for name in now:  # every version can be read, and is whole
                for version in kept.versions(name):
                    json.loads(kept.read(name, version.revision)[0])
            if told:
                _, texts = told[-1]
                # One more step may have been done and not told: it changes one or two names.
                differ = {n for n in {*now, *texts} if now.get(n) != texts.get(n)}
                assert len(differ) <= 2
                every = {
                    kept.read(n, one.revision)[0]
                    for n in [*now, *kept.names(are_removed=True)]
                    for one in kept.versions(n)
                }
                assert {*texts.values()} <= every, "a confirmed edit is lost"
