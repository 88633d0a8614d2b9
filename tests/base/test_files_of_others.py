"""What is written over: links, pipes, devices, modes, and the files of others."""

import os
import signal
import stat
import tempfile
import traceback
from pathlib import Path

import pytest

from haptix.base import files
from haptix.base.errors import FileFormatError, InputError
from haptix.lab.experiment.trial_log import TouchLog, TrialLog
from haptix.play.render.intervals import TouchSample

NOBODY, SOMEBODY = 65534, 12345
SECRET = 0o600


@pytest.fixture
def written(tmp_path):
    """A file with a mode of its own."""
    path = tmp_path / "a"
    path.write_text("old")
    path.chmod(0o640)
    return path


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("write", [files.write_whole, lambda path, text: whole_set(path, text)])
def test_a_link_is_followed_and_stays_one(tmp_path, written, write):
    (tmp_path / "links").mkdir()
    link = tmp_path / "links" / "link"
    link.symlink_to("../a")
    write(link, "new")
    assert link.is_symlink() and link.readlink() == Path("../a")
    assert written.read_text() == "new"
    assert names(tmp_path) == ["a", "links"] and "link" in names(tmp_path / "links")


def whole_set(path, text):
    files.write_folder(path.parent, {path.name: text, "manifest": "x"})


def test_a_link_to_nothing_makes_its_file(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "made")
    files.write_whole(tmp_path / "link", "new")
    assert (tmp_path / "made").read_text() == "new"
    assert (tmp_path / "link").is_symlink()


def test_links_in_a_ring_are_refused(tmp_path):
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(FileFormatError, match="cannot write"):
        files.write_whole(tmp_path / "a", "new")
    assert names(tmp_path) == ["a", "b"]


@pytest.mark.parametrize("mode", [0o640, 0o600, 0o666, 0o755])
def test_a_file_keeps_its_mode_and_nobody_reads_the_draft(written, mode):
    written.chmod(mode)
    modes = []

    def write(draft):
        modes.append(stat.S_IMODE(draft.stat().st_mode))
        draft.write_text("new")

    files.write_whole(written, write)
    assert stat.S_IMODE(written.stat().st_mode) == mode
    assert modes == [SECRET]


@pytest.mark.parametrize("kind", ["pipe", "socket", "device", "full", "folder"])
def test_what_is_no_regular_file_is_refused_and_stays(tmp_path, kind):
    path = tmp_path / "out"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "socket":
        os.mknod(path, stat.S_IFSOCK | 0o600)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/full" if kind == "full" else "/dev/null")
    before = path.stat()
    message = "Is a directory" if kind == "folder" else "regular file"
    for write in (files.write_whole, whole_set):
        with pytest.raises((FileFormatError, InputError), match=message):
            write(path, "new")
    assert (path.stat().st_ino, path.stat().st_mode) == (before.st_ino, before.st_mode)
    assert names(tmp_path) == ["out"]
    if kind != "folder":
        with pytest.raises(InputError, match="no regular file"):
            files.check_folder(tmp_path, ["out"])


def logs_a_trial(path):
    TrialLog(path, {})


def logs_a_touch(path):
    sample = TouchSample(0.0, 1.0, 2.0, None, 0, "down")
    TouchLog(path.with_name("trials.tsv")).append(1, 1, 1, [sample])


@pytest.mark.parametrize("write", [logs_a_trial, logs_a_touch])
def test_a_log_of_trials_is_no_pipe(tmp_path, write):
    """Whoever opens a pipe waits for its other end, which may never come."""
    path = tmp_path / "trials_touches.tsv"
    os.mkfifo(path)
    with pytest.raises(InputError, match="regular file"):
        write(path)
    assert stat.S_ISFIFO(path.stat().st_mode)


def test_a_secret_is_nobody_elses_from_the_first_and_follows_no_link(tmp_path, monkeypatch):
    modes, opened = [], os.open

    def opens(path, *arguments, **options):
        number = opened(path, *arguments, **options)
        if str(path).startswith(str(tmp_path)):  # and of no other thread's
            modes.append((os.fstat(number).st_size, stat.S_IMODE(os.fstat(number).st_mode)))
        return number

    foreign = tmp_path / "foreign"
    foreign.write_text("theirs")
    (tmp_path / "secret").symlink_to(foreign)
    monkeypatch.setattr(os, "open", opens)
    umask = os.umask(0)
    try:
        files.write_whole(tmp_path / "secret", "mine", is_secret=True)
    finally:
        os.umask(umask)
    assert modes[0] == (0, SECRET)
    assert not (tmp_path / "secret").is_symlink() and foreign.read_text() == "theirs"
    assert stat.S_IMODE((tmp_path / "secret").stat().st_mode) == SECRET


# --- as an ordinary user -------------------------------------------------------------------------


def as_nobody(act):
    """Do it in a process of a user who owns nothing; return what it raised."""
    reads, writes = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.setgroups([])
            os.setgid(NOBODY)
            os.setuid(NOBODY)
            act()
        except FileFormatError as error:
            os.write(writes, str(error).encode())
        except BaseException:
            os.write(writes, traceback.format_exc().encode())
        os.kill(os.getpid(), signal.SIGKILL)  # nothing of the tests ends here
    os.close(writes)
    with os.fdopen(reads) as file:
        told = file.read()
    os.waitpid(child, 0)
    return told


@pytest.fixture
def shared():
    """A folder in which everyone may write, and remove what is their own only."""
    if not hasattr(os, "getuid") or os.getuid() != 0:
        pytest.skip("needs root, to become another user")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o1777)
        yield folder


@pytest.mark.optional
def test_an_ordinary_user_and_the_files_of_others(shared):
    """Each is refused with a sentence, and what was there is there."""
    foreign, closed = shared / "foreign", shared / "closed"
    for path, mode in ((foreign, 0o666), (closed, 0o644)):
        path.write_text("theirs")
        path.chmod(mode)
    (shared / "own").mkdir()  # what stands in their own folder they could replace
    os.chown(shared / "own", NOBODY, NOBODY)
    inside = shared / "own" / "inside"
    inside.write_text("theirs")
    inside.chmod(0o666)
    (shared / "sealed").mkdir(mode=0o755)
    sealed = shared / "sealed" / "sealed"
    sealed.write_text("old")
    os.chown(sealed, NOBODY, NOBODY)
    mine = shared / "own" / "mine"
    mine.write_text("old")
    os.chown(mine, NOBODY, NOBODY)
    mine.chmod(0o400)
    (shared / "own" / "bait").symlink_to(mine)
    for path, why in [
        (foreign, "another user"),
        (inside, "another user"),
        (closed, "Permission denied"),
        (sealed, "Permission denied"),
        (mine, "Permission denied"),
        (shared / "sealed" / "new", "Permission denied"),
    ]:
        text = path.read_text() if path.exists() else None
        told = as_nobody(lambda path=path: files.write_whole(path, "new"))
        assert why in told and "Traceback" not in told, (path, told)
        assert (path.read_text() if path.exists() else None) == text
    mine.chmod(0o600)
    assert as_nobody(lambda: files.write_whole(shared / "own" / "bait", "new")) == ""
    assert mine.read_text() == "new" and mine.stat().st_uid == NOBODY
    assert not list(shared.rglob("*.part"))


@pytest.mark.optional
def test_root_keeps_the_owner(shared):
    path = shared / "theirs"
    path.write_text("old")
    os.chown(path, SOMEBODY, NOBODY)
    path.chmod(0o640)
    os.chown(shared, SOMEBODY, SOMEBODY)
    files.write_whole(path, "new")
    found = path.stat()
    assert (found.st_uid, found.st_gid, stat.S_IMODE(found.st_mode)) == (SOMEBODY, NOBODY, 0o640)


@pytest.mark.optional
def test_a_strangers_link_in_a_shared_folder_is_not_followed(shared, tmp_path):
    """As the system has it, where it has it: see protected_symlinks of proc(5)."""
    guard = Path("/proc/sys/fs/protected_symlinks")
    if not guard.exists() or guard.read_text().strip() != "1":
        pytest.skip("needs a system that protects links")
    for target in (tmp_path / "there", tmp_path / "none"):
        link = shared / target.name
        link.symlink_to(target)
        os.chown(link, SOMEBODY, SOMEBODY, follow_symlinks=False)
        if target.name == "there":
            target.write_text("old")
        with pytest.raises(FileFormatError, match="Permission denied"):
            files.write_whole(link, "new")
        assert not target.exists() or target.read_text() == "old"
