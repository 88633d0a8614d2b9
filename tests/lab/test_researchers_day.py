"""A researcher's day, typed from the page: stopped at random places, nothing is lost or doubled."""

import json
import os
import random
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "experiment.md"
PLACES = random.Random(16)
KILLS = 2  # of each session


def lines_of(log):
    """Lines that are whole; none before the log is there."""
    data = log.read_bytes() if log.exists() else b""
    return data[: data.rfind(b"\n") + 1].splitlines(keepends=True)


def haptix(line, **more):
    name, *arguments = shlex.split(line)
    assert name == "haptix"
    return subprocess.Popen(
        [sys.executable, "-m", "haptix.tasks.cli", *arguments],
        stdout=subprocess.PIPE,
        text=True,
        **more,
    )


def finished(process):
    out, _ = process.communicate(timeout=600)
    assert process.returncode == 0, out
    return out


def killed(line, is_there):
    """Run until something is there, then kill; False if it was over before."""
    process = haptix(line)
    until = time.monotonic() + 300
    while process.poll() is None and not is_there():
        assert time.monotonic() < until, f"waited for a place in: {line}"
        time.sleep(0.005)
    if process.poll() is None:
        os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    return process.returncode == -signal.SIGKILL


def run_with_kills(line, log, record):
    """Kill a session among its trials and while its files are written, then let it end."""
    kills = 0
    for number in range(KILLS):
        before = lines_of(log)
        rows = len(before) + PLACES.randint(1, 60)
        is_last = record is not None and number == KILLS - 1
        kills += killed(
            line, record.exists if is_last else (lambda rows=rows: len(lines_of(log)) >= rows)
        )
        assert lines_of(log)[: len(before)] == before, "acknowledged trials were lost"
    before = lines_of(log)
    finished(haptix(line))
    assert lines_of(log)[: len(before)] == before
    return kills


def rows_of(log):
    names, *rows = (line.decode().rstrip("\n").split("\t") for line in lines_of(log)[1:])
    return [dict(zip(names, row, strict=True)) for row in rows]


@pytest.mark.slow  # each part is tested by itself: logs, studies, analysis
def test_the_day_of_the_page_with_kills(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HAPTIX_CACHE", str(tmp_path / "cache"))
    block = re.search(r"```sh\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert block is not None
    kills, logs, sessions = 0, {}, []
    for line in block[1].splitlines():
        if " run " not in line:
            finished(haptix(line))
            continue
        who = shlex.split(line)[shlex.split(line).index("--participant") + 1]
        if "--study" in line:
            place = Path("roughness/sourcedata") / f"sub-{who}" / "ses-01"
            base = f"sub-{who}_ses-01_task-detection"
            log, record = place / f"{base}_log.tsv", place / f"{base}_files.json"
        else:
            log, record = Path("elsewhere.tsv"), None
        sessions.append((who, line))
        logs[who] = log
        kills += run_with_kills(line, log, record)
    assert kills >= len(sessions)  # the last is in time for some exports
    # A session that was never stopped has the same trials, one after the other.
    who, line = sessions[0]
    finished(haptix(line.replace("--study roughness", "--study whole")))
    whole = Path("whole/sourcedata") / logs[who].relative_to("roughness/sourcedata")
    names = ("trial", "attempt", "kind", "condition", "level", "right", "answer", "accepted")
    found, expected = (
        [[row[n] for n in names] for row in rows_of(one)] for one in (logs[who], whole)
    )
    assert found == expected
    for log in logs.values():
        rows = rows_of(log)
        assert [int(row["trial"]) for row in rows] == list(range(len(rows)))
        assert sum(row["kind"] == "trial" for row in rows) > 40
        times = [float(row["time_s"]) for row in rows]
        assert times == sorted(times) and int(rows[-1]["session"]) > 1
    study = Path("roughness")
    people = [line.split("\t")[0] for line in (study / "participants.tsv").read_text().splitlines()]
    assert people == ["participant_id", "sub-01", "sub-02", "sub-03"]
    for who, log in logs.items():
        (beh,) = study.glob(f"sub-{who}/ses-01/beh/*_beh.tsv")
        assert len(beh.read_text().splitlines()) == len(rows_of(log)) + 1
    (tables,) = json.loads(finished(haptix("haptix stimuli analyse roughness --json")))
    assert len(tables["thresholds"]) == 6 and tables["notes"] == []
    truths = {"01": 24.0, "02": 26.0, "03": 22.0}
    for row in tables["thresholds"]:
        # A walk settles within 1 dB of the threshold (its share is another); 4 spreads beside it.
        off = abs(row["threshold_db"] - truths[row["participant"]])
        assert off < 1 + row["high_db"] - row["low_db"]
    validator = shutil.which("bids-validator-deno", path=Path(sys.executable).parent)
    assert validator is not None, "install the dev extra"
    done = subprocess.run(
        [validator, "roughness", "--format", "json"], capture_output=True, text=True, timeout=300,
        check=False,
    )  # fmt: skip
    issues = json.loads(done.stdout)["issues"]["issues"]
    errors = [one for one in issues if one.get("severity") == "error"]
    assert not errors, json.dumps(errors, indent=1)[:4000]
