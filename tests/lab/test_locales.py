"""The same bytes wherever: locale with decimal commas, time zone, folder, threads, hash seed."""

import os
import subprocess
import sys

import pytest

RECIPE = """
schema_version = 1
name = "set"
[[designs]]
kind = "factorial"
name = "bumps"
factors = { "signal.frequency_hz" = [37.5, 41.25] }
[designs.base]
quantity = "contrast"
length_s = 0.05
signal = { kind = "sine", amplitude = 0.01, offset = 0.0125, frequency_hz = 37.5 }
"""

EXPERIMENT = """
name = "mine"
task = "2afc"
[stimulus]
quantity = "contrast"
length_s = 0.01
signal = { kind = "constant", value = 1.0 }
[method]
kind = "up-down"
start = -16.5
steps = [4.0, 1.5]
stop_after = 4
"""

# As programs of a laboratory do that bring haptix along; Python alone leaves numbers as they are.
IN_LOCALE = """
import locale, sys
locale.setlocale(locale.LC_ALL, "")
assert locale.localeconv()["decimal_point"] == sys.argv.pop(1)
from haptix.tasks.cli import main
main()
"""
# Times, and the hash of the line above, which has times in it.
OF_THE_RUN = {"time_s", "onset_s", "reaction_s", "date", "before"}


@pytest.mark.devices  # needs Debian's locales, and processes with torch
def test_files_do_not_depend_on_where_they_are_made(tmp_path):
    subprocess.run(
        ["localedef", "-i", "de_DE", "-f", "UTF-8", tmp_path / "de_DE.UTF-8"], check=True
    )
    found = []
    for name, point, threads, more in (
        ("plain", ".", "1", {"LC_ALL": "C", "TZ": "UTC", "PYTHONHASHSEED": "1"}),
        ("größe 2", ",", "2", {"LC_ALL": "de_DE.UTF-8", "TZ": "Asia/Kolkata",
                               "PYTHONHASHSEED": "77"}),
    ):  # fmt: skip
        place = tmp_path / name
        place.mkdir()
        (place / "set.toml").write_text(RECIPE)
        (place / "experiment.toml").write_text(EXPERIMENT)
        environment = {**os.environ, "LOCPATH": str(tmp_path), **more}
        environment["HAPTIX_CACHE"] = str(place / "cache")
        for line in (
            f"make set.toml --out out --threads {threads}",
            "run experiment.toml --study study --participant 03 --simulate-db -22.5",
            "analyse study",
        ):
            done = subprocess.run(
                [sys.executable, "-c", IN_LOCALE, point, "stimuli", *line.split()],
                cwd=place, env=environment, capture_output=True, text=True, check=False,
            )  # fmt: skip
            assert done.returncode == 0, done.stderr
        files = {
            path.relative_to(place).as_posix(): path.read_bytes()
            for folder in ("out", "study/derivatives")
            for path in (place / folder).rglob("*")
            if path.is_file() and path.suffix not in (".html", ".png")  # drawn by a library
        }
        (log,) = (place / "study" / "sourcedata").rglob("*_log.tsv")
        head, names, *rows = log.read_text().splitlines()
        kept = [k for k, one in enumerate(names.split("\t")) if one not in OF_THE_RUN]
        cells = [row.split("\t") for row in rows]
        found.append((files, head, [[row[k] for k in kept] for row in cells]))
    assert len(found[0][0]) > 8
    for path, data in found[0][0].items():
        assert data == found[1][0][path], path
    assert found[0] == found[1]
