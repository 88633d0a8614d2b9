"""What each kind of document notices when it is damaged: the table of docs/safety.md, measured."""

import io
import pickle
import re
from contextlib import suppress
from pathlib import Path

import numpy as np
import soundfile
from PIL import Image

import haptix
from haptix.base.errors import HaptixError
from haptix.feel import RecordedProfile, Trajectory
from haptix.feel.materials.pictures import read_grey
from haptix.feel.signals.audio_files import read_audio
from haptix.lab.experiment import trial_log
from haptix.lab.experiment.trial_log import COLUMNS, End, line_hash, parse_log
from haptix.play.touch.recordings import read_events
from haptix.service.front.rest import KeptTexts
from haptix.service.protocol.messages import Problem

PAGE = Path(haptix.__file__).parents[1] / "docs" / "safety.md"
PLACES = 40
RNG = np.random.default_rng(3)


def table(names, row):
    lines = [",".join(names), *(",".join(f"{x:.3f}" for x in row(n)) for n in range(40))]
    return ("\n".join(lines) + "\n").encode()


def audio(form):
    file = io.BytesIO()
    soundfile.write(file, RNG.uniform(-0.5, 0.5, 2000), 48_000, "PCM_16", format=form)
    return file.getvalue()


def picture():
    file = io.BytesIO()
    Image.fromarray(RNG.integers(0, 256, (24, 32), np.uint8)).save(file, "PNG")
    return file.getvalue()


def log():
    head = f'# {{"format": {trial_log._FORMAT}, "method": "staircase"}}\n' + "\t".join(COLUMNS)
    lines, last = [head], line_hash(head)
    for number in range(30):
        cells = {"trial": str(number), "level": f"{0.1 * number:.2f}", "before": last}
        lines.append("\t".join(cells.get(name, "n/a") for name in COLUMNS))
        last = line_hash(lines[-1])
    return ("\n".join(lines) + "\n").encode(), End(rows=30, last=last, finished=True)


LOG, END = log()


def kept_layout(path):
    store = KeptTexts(path.parent / "layouts", {"regions": list})
    (path.parent / "layouts" / "a").mkdir(exist_ok=True)
    (path.parent / "layouts" / "a" / "1.json").write_bytes(path.read_bytes())
    return store.read("a")


def regions():
    region = '{{"name":"r{0}","material":{{"kind":"button"}},"x_mm":{0}.5}}'
    lines = ",\n".join(region.format(number) for number in range(30))
    return f'{{"regions":[\n{lines}\n]}}'.encode()


KINDS = {
    "log of trials, with its end file": (
        LOG, ".tsv", lambda path: parse_log(path, path.read_bytes(), END),
    ),
    "PNG": (picture(), ".png", read_grey),
    "FLAC": (audio("FLAC"), ".flac", read_audio),
    "WAV": (audio("WAV"), ".wav", read_audio),
    "CSV of touches": (
        table(("t_s", "x_mm", "y_mm"), lambda n: (n / 100, n / 3, 5)), ".csv", read_events,
    ),
    "CSV of a stroke": (
        table(("t_s", "x_mm", "y_mm", "normal_force_n"), lambda n: (n / 100, n / 3, 5, 0.5)),
        ".csv", Trajectory.from_csv,
    ),
    "CSV of friction along a line": (
        table(("position_mm", "mu"), lambda n: (n / 3, 0.3 + n % 3 / 10)),
        ".csv", RecordedProfile.from_csv,
    ),
    "kept layout (JSON)": (regions(), ".json", kept_layout),
}  # fmt: skip


def is_text(content):
    return not re.search(rb"[^\t\r\n -~]", content)


def cut(content, at):
    return content[: max(1, int(content.__len__() * at))]


def header(content, at):
    end = content.index(b"\n") if is_text(content) else 12
    where = int(end * at)
    return content[:where] + bytes([content[where] ^ 1]) + content[where + 1 :]


def doubled(content, at):
    """A line, or 64 bytes, twice."""
    if is_text(content):
        lines = content.splitlines(keepends=True)
        where = 2 + int((len(lines) - 4) * at)
        return b"".join([*lines[: where + 1], *lines[where:]])
    where = 64 + int((len(content) - 200) * at)
    return content[: where + 64] + content[where:]


def changed(content, at):
    """A digit of a number, or a bit."""
    if is_text(content):
        digits = [one.start() for one in re.finditer(rb"\d", content)]
        where = digits[int(len(digits) // 4 + (len(digits) * 0.7) * at)]
        digit = bytes([48 + (content[where] - 47) % 10])
        return content[:where] + digit + content[where + 1 :]
    where = 64 + int((len(content) - 100) * at)
    return content[:where] + bytes([content[where] ^ 4]) + content[where + 1 :]


DAMAGES = {"cut off": cut, "header changed": header, "row doubled": doubled, "digit": changed}


def mistaken(kind, damage, folder):
    """How many damages at `PLACES` places are read as something else."""
    content, suffix, read = KINDS[kind]
    path = folder / f"document{suffix}"
    path.write_bytes(content)
    whole = pickle.dumps(read(path))
    count = 0
    for place in range(PLACES):
        path.write_bytes(damage(content, (place + 0.5) / PLACES))
        with suppress(HaptixError, Problem):
            count += pickle.dumps(read(path)) != whole
    return count


def test_the_page_says_what_each_kind_notices(tmp_path):
    text = PAGE.read_text("utf-8")
    measured = {
        kind: [
            {0: "all", PLACES: "none"}.get(mistaken(kind, damage, tmp_path), "some")
            for damage in DAMAGES.values()
        ]
        for kind in KINDS
    }
    lines = [f"| {kind} | {' | '.join(row)} |" for kind, row in measured.items()]
    for line in lines:
        assert line in text, "\n" + "\n".join(lines)
