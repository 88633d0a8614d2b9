"""Files: whole or not at all, and errors that name the place."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from haptix.base import files
from haptix.base.errors import FileFormatError, InputError


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_replaced_whole(tmp_path):
    path = tmp_path / "new" / "a.txt"
    files.write_whole(path, "old µ\r\n")
    assert path.read_bytes() == "old µ\r\n".encode()
    files.write_whole(path, b"new")
    files.write_whole(tmp_path / "new" / "b", lambda draft: draft.write_bytes(b"by a function"))
    assert path.read_bytes() == b"new"
    assert (tmp_path / "new" / "b").read_bytes() == b"by a function"
    assert names(tmp_path / "new") == ["a.txt", "b"]


def test_others_may_read_what_is_written(tmp_path):
    files.write_whole(tmp_path / "a", b"")
    (tmp_path / "b").write_bytes(b"")
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "b").stat().st_mode


def test_a_writer_that_fails_leaves_what_was_there(tmp_path):
    path = tmp_path / "a"
    files.write_whole(path, "old")

    def fill_up(draft):
        draft.write_text("ne")
        raise OSError(28, "No space left on device")

    with pytest.raises(FileFormatError, match="a: No space left"):
        files.write_whole(path, fill_up)
    assert path.read_text() == "old" and names(tmp_path) == ["a"]
    with pytest.raises(FileFormatError, match="cannot write"):
        files.write_whole(tmp_path / "a" / "b", "below a file")


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs POSIX's SIGKILL")
def test_a_killed_process_leaves_the_old_file(tmp_path):
    path = tmp_path / "a"
    path.write_text("old")
    code = """
import pathlib, sys, time
from haptix.base.files import write_whole
def slowly(draft):
    draft.write_text("half")
    print("half", flush=True)
    time.sleep(60)
write_whole(pathlib.Path(sys.argv[1]), slowly)
"""
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True
    )
    assert child.stdout.readline() == "half\n"
    child.kill()
    child.communicate()
    assert path.read_text() == "old"


def test_content_and_name_reach_the_disk_in_this_order(tmp_path, monkeypatch):
    done = []
    fsync, replace = os.fsync, Path.replace
    monkeypatch.setattr(os, "fsync", lambda fd: (done.append("sync"), fsync(fd))[1])
    monkeypatch.setattr(
        Path, "replace", lambda self, to: (done.append(to.name), replace(self, to))[1]
    )
    files.write_folder(tmp_path, {"a": b"1", "b": b"2", "manifest": b"3"})
    # Contents, names, folder; the manifest after all that it lists, and its folder again.
    assert done == ["sync"] * 3 + ["a", "b", "sync", "manifest", "sync"]


def test_an_old_manifest_never_lists_new_files(tmp_path, monkeypatch):
    first = {"a": "old", "manifest": "old"}
    files.write_folder(tmp_path, first)

    def fail(self, to):
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fail)
        with pytest.raises(InputError, match="Input/output"):
            files.write_folder(tmp_path, {"a": "new", "manifest": "new"})
    assert names(tmp_path) == ["a"]
    assert files.write_folder(tmp_path, first) == [tmp_path / "a", tmp_path / "manifest"]
    assert names(tmp_path) == ["a", "manifest"]


def test_a_set_with_a_writer_that_fails_changes_nothing(tmp_path):
    files.write_folder(tmp_path, {"a": "old", "manifest": "old"})

    def fail(draft):
        raise OSError("too big")

    with pytest.raises(InputError, match="too big"):
        files.write_folder(tmp_path, {"a": "new", "manifest": fail})
    assert (tmp_path / "a").read_text() == (tmp_path / "manifest").read_text() == "old"
    assert names(tmp_path) == ["a", "manifest"]


def test_two_processes_do_not_share_a_temporary_name(tmp_path):
    """Each writes its own content while the other does; the file is one of the two."""
    code = """
import sys
from haptix.base.files import write_whole
for _ in range(200):
    write_whole(sys.argv[1], sys.argv[2] * 5000)
"""
    path = tmp_path / "a"
    children = [subprocess.Popen([sys.executable, "-c", code, path, text]) for text in "xy"]
    while any(child.poll() is None for child in children):
        if path.exists():
            assert len(set(path.read_text())) == 1
        time.sleep(0.001)
    assert [child.returncode for child in children] == [0, 0]
    assert names(tmp_path) == ["a"]


def test_a_folder_is_checked_before_the_work(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "a.png").mkdir()
    files.check_folder(tmp_path / "new" / "one", ["a.png"])
    with pytest.raises(InputError, match="is a file"):
        files.check_folder(tmp_path / "file" / "below", ["a.png"])
    with pytest.raises(InputError, match=r"a\.png .*folder"):
        files.check_folder(tmp_path, ["a.png"])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[1]", "expected a JSON object"),
        (b"{", "expected a JSON file"),
        (b'{"a": NaN}', "NaN is no number of JSON"),
        (b'{"a": [{"b": 1, "c": 2, "b": 3}]}', "the name 'b' stands twice"),
        (b"[" * 100_000, "expected a JSON file"),
        (b"\xff\xfe", "expected a text file in UTF-8, got another encoding; save it as UTF-8"),
    ],
)
def test_what_is_no_json_object_is_refused(tmp_path, content, message):
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(FileFormatError, match=message):
        files.read_json(tmp_path / "a.json")


def test_json_goes_there_and_back(tmp_path):
    table = {"name": "µ", "values": [1, 0.1, None, True]}
    files.write_whole(tmp_path / "a.json", files.json_text(table))
    assert files.read_json(tmp_path / "a.json") == table
    with pytest.raises(ValueError, match="not JSON compliant"):
        files.json_text({"a": float("nan")})


def test_toml_is_read_or_refused(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbfa = 1\r\nb = 2\r\n")  # as Windows writes it
    assert files.read_toml(tmp_path / "a.toml") == {"a": 1, "b": 2}
    (tmp_path / "a.toml").write_text("a =")
    with pytest.raises(FileFormatError, match="TOML"):
        files.read_toml(tmp_path / "a.toml")
    with pytest.raises(FileFormatError, match="cannot read"):
        files.read_toml(tmp_path / "missing.toml")


def test_csv_goes_there_and_back(tmp_path):
    rows = [(1, 0.1, None), (2, 1 / 3, "a, b")]
    text = files.csv_text(("n", "x", "note"), rows)
    assert text == 'n,x,note\n1,0.1,\n2,0.3333333333333333,"a, b"\n'
    assert files.csv_text(("x",), [(1 / 3,)], digits=3) == "x\n0.333\n"
    (tmp_path / "a.csv").write_text(text.replace("2,", "\n2,") + "\n\n")
    one, two = files.read_csv(tmp_path / "a.csv", ["x", "n"], ["note"])
    assert (one.whole("n"), one.number("x"), one.cells["note"]) == (1, 0.1, "")
    assert (two.whole("n"), two.number("x"), two.cells["note"]) == (2, 1 / 3, "a, b")
    assert two.place.endswith("a.csv, line 4")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a first line naming t, x"),
        ("t\n1\n", r"missing or repeated: x; found: t"),
        ("t,x,x\n1,2,3\n", "missing or repeated: x"),
        ("t,x\n1\n", r"line 2: expected 2 values, got 1; x is missing"),
        ("t,x\n1,2,3\n", r"line 2: expected 2 values, got 3; decimals need a point"),
        ("t,x\n1,2\n\n3,a\n", r"line 4: x: expected a number, got 'a'"),
    ],
)
def test_what_is_no_such_table_is_refused(tmp_path, text, message):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(FileFormatError, match=message):
        [row.number("x") for row in files.read_csv(tmp_path / "a.csv", ["t", "x"])]


def test_the_cache_is_where_it_was(monkeypatch, tmp_path):
    monkeypatch.delenv("HAPTIX_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if sys.platform == "linux":
        assert files.cache_folder() == tmp_path / "haptix"
        monkeypatch.delenv("XDG_CACHE_HOME")
        monkeypatch.setenv("HOME", str(tmp_path))
        assert files.cache_folder() == tmp_path / ".cache" / "haptix"
    monkeypatch.setenv("HAPTIX_CACHE", str(tmp_path / "own"))
    assert files.cache_folder() == tmp_path / "own"


def test_a_full_disk_is_named_by_its_path_with_what_is_free(tmp_path, monkeypatch):
    def fill_up(draft):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=40_000))
    monkeypatch.setattr("os.path.ismount", lambda path: path == tmp_path)
    told = (
        rf"No space left on device: the disk at {tmp_path} has 0\.04 MB free; make room there, or "
        "name a place on another"
    )
    path = tmp_path / "new" / "a"
    with pytest.raises(FileFormatError, match=f"cannot write {path}: {told}"):
        files.write_whole(path, fill_up)
    with pytest.raises(InputError, match=f"cannot write to {path.parent}: {told}"):
        files.write_folder(path.parent, {"a": fill_up})
