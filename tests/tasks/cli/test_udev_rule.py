"""``haptix doctor --install-udev``, below a folder that stands for /."""

import os

import pytest
from typer.testing import CliRunner

from firmware_io.links.usb import RULE_FILE, udev_rule, udev_rule_is_installed
from haptix.tasks.cli.application import app


def doctor(root, *arguments, answer=None):
    return CliRunner().invoke(app, ["doctor", "--root", str(root), *arguments], input=answer)


def test_it_asks_and_writes(tmp_path):
    done = doctor(tmp_path, "--install-udev", answer="y\n")
    assert done.exit_code == 0
    assert "Write it?" in done.output
    assert udev_rule_is_installed(tmp_path)
    text = (tmp_path / RULE_FILE).read_text()
    assert text in done.output
    assert text.count('"1209"') == text.count('"0001"') == text.count("uaccess") == 2
    assert "there already" in doctor(tmp_path, "--install-udev").output


@pytest.mark.parametrize("answer", ["n\n", "\n", ""])
def test_it_writes_nothing_without_a_yes(tmp_path, answer):
    done = doctor(tmp_path, "--install-udev", answer=answer)
    assert done.exit_code == 1
    assert not (tmp_path / "etc").exists()


def test_an_old_rule_is_replaced(tmp_path):
    path = tmp_path / RULE_FILE
    path.parent.mkdir(parents=True)
    path.write_text("# an earlier one\n")
    assert not udev_rule_is_installed(tmp_path)
    assert doctor(tmp_path, "--install-udev", "--yes").exit_code == 0
    assert path.read_text() == udev_rule()


def test_a_rule_that_is_a_device_stays_one(tmp_path):
    path = tmp_path / "etc/udev/rules.d/70-haptix.rules"
    path.parent.mkdir(parents=True)
    path.symlink_to("/dev/full")
    done = doctor(tmp_path, "--install-udev", "--yes")
    assert (done.exit_code, "regular file" in done.output) == (2, True)
    assert path.is_symlink()


def test_where_it_may_not_write(tmp_path):
    (tmp_path / "etc").write_text("a file where a folder should be")
    done = doctor(tmp_path, "--install-udev", "--yes")
    assert done.exit_code == 2
    assert "sudo haptix doctor --install-udev" in done.output


def test_the_doctor_tells_what_is_missing(tmp_path):
    shown = doctor(tmp_path, "--json").output
    assert "70-haptix.rules is not there" in shown
    doctor(tmp_path, "--install-udev", "--yes")
    shown = doctor(tmp_path, "--json").output
    assert f"{os.fspath(tmp_path / RULE_FILE)}" in shown
    assert "is not there" not in shown
