"""Packages of others called as ours: a sentence says where they lie, never a traceback."""

import json
import os
import subprocess
import sys

import pytest

import haptix
from haptix.base.version import foreign_package


@pytest.fixture
def foreign(tmp_path):
    def run(name, *words):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").touch()
        env = {**os.environ, "PYTHONPATH": str(tmp_path)}
        return subprocess.run(
            [sys.executable, *words],
            env=env,
            capture_output=True,
            text=True,
            check=False,
            cwd=tmp_path,
        )

    return run


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("calibration", ("-m", "haptix.tasks.cli", "calibrate", "--help")),
        ("firmware_io", ("-m", "haptix.tasks.cli", "demo")),
        ("firmware_io", ("-m", "haptix.tasks.cli", "doctor")),
    ],
)
def test_a_command_says_so_in_a_sentence(foreign, tmp_path, name, words):
    done = foreign(name, *words)
    assert done.returncode == 2
    assert done.stderr.startswith(f"haptix: {name}: expected the package that came with haptix")
    assert str(tmp_path / name) in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow  # a process with torch
def test_the_doctor_says_so_of_what_it_can_do_without(foreign, tmp_path):
    done = foreign("calibration", "-m", "haptix.tasks.cli", "doctor", "--json")
    assert done.returncode == 1
    rows = {row["check"]: row for row in json.loads(done.stdout)}
    assert rows["packages"]["ok"] == "no"
    assert str(tmp_path / "calibration") in rows["packages"]["detail"]


def test_commands_without_it_work(foreign):
    done = foreign("calibration", "-m", "haptix.tasks.cli", "--version")
    assert done.stdout == f"haptix {haptix.__version__}\n"


def test_python_is_told_at_the_first_use(foreign, tmp_path):
    done = foreign("firmware_io", "-c", "import haptix; haptix.open_device")
    assert done.stderr.splitlines()[-1].startswith("ImportError: firmware_io: expected the package")
    assert str(tmp_path / "firmware_io") in done.stderr


def test_another_distribution_in_the_same_folder_is_named(haptix_cli, tmp_path, monkeypatch):
    record = tmp_path / "calibration_of_others-1.dist-info"
    record.mkdir()
    (record / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: calibration-of-others\nVersion: 1\n"
    )
    (record / "RECORD").write_text("calibration/__init__.py,,\ncalibration_of_others/a.py,,\n")
    monkeypatch.syspath_prepend(tmp_path)
    rows = {row["check"]: row for row in json.loads(haptix_cli("doctor", "--json").out)}
    assert rows["packages"]["ok"] == "no"
    assert "calibration-of-others" in rows["packages"]["detail"]


def test_our_own_are_ours():
    assert [foreign_package(name) for name in ("calibration", "firmware_io")] == ["", ""]
