"""``haptix cache``: it lists what can be made again, removes that, and nothing else."""

import json
import tempfile

import pytest

from firmware_io.firmware import build

KEY = "0123456789abcdef" * 4


@pytest.fixture
def places(private_cache, tmp_path, monkeypatch):
    """Caches of this test alone: of surfaces, of the compiled firmware, and its second choice."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    found = {"surfaces": private_cache}
    found["compiled"], found["second"] = build._cache_folders()
    for folder in found.values():
        assert folder.is_relative_to(tmp_path)
        folder.mkdir(mode=0o700, parents=True)
    return found


@pytest.fixture
def kept(places):
    files = [
        places["surfaces"] / f"{KEY}.surface",
        places["surfaces"] / f".{KEY}.surface.00112233aabbccdd.part",
        places["compiled"] / "haptix-firmware-00112233aabbccdd.so",
        places["compiled"] / "haptix-firmware-00112233aabbccdd.sha256",
        places["second"] / "haptix-firmware-ffeeddccbbaa0011.so",
    ]
    for file in files:
        file.write_bytes(b"x" * 1000)
    return files


@pytest.fixture
def others(places):
    """What a person may have put beside them."""
    files = [
        places["surfaces"] / "my.surface",
        places["surfaces"] / f"{KEY}.nc",
        places["surfaces"] / f".my.surface.{KEY[:16]}.part",
        places["compiled"] / "notes.so",
    ]
    for file in files:
        file.write_bytes(b"mine")
    return files


def by_kind(shown):
    assert shown.code == 0, shown.err
    return {row["kept"]: row for row in json.loads(shown.out)}


def test_it_lists_what_is_kept_and_where(haptix_cli, places, kept, others):
    rows = by_kind(haptix_cli("cache", "--json"))
    assert [row["files"] for row in rows.values()] == [2, 3]
    assert rows["surfaces"]["bytes"] == 2000
    assert rows["surfaces"]["folder"] == str(places["surfaces"])
    assert rows["compiled firmware"]["bytes"] == 3000
    assert rows["compiled firmware"]["folder"] == f"{places['compiled']}, {places['second']}"
    assert all(file.exists() for file in (*kept, *others))
    assert "surfaces" in haptix_cli("cache").out


def test_it_clears_that_and_nothing_else(haptix_cli, kept, others):
    rows = by_kind(haptix_cli("cache", "--clear", "--json"))
    assert [row["files"] for row in rows.values()] == [2, 3]
    assert not any(file.exists() for file in kept)
    assert all(file.read_bytes() == b"mine" for file in others)
    assert {row["files"] for row in by_kind(haptix_cli("cache", "--json")).values()} == {0}


def test_without_a_cache_there_is_nothing_to_clear(haptix_cli, places):
    for folder in places.values():
        folder.rmdir()
    rows = by_kind(haptix_cli("cache", "--clear", "--json"))
    assert {row["files"] for row in rows.values()} == {0}
    assert not any(folder.exists() for folder in places.values())


def test_a_file_in_use_is_told_and_all_others_go(haptix_cli, kept, monkeypatch):
    remove = type(kept[0]).unlink

    def refuse(path, missing_ok=False):
        if path == kept[0]:
            raise PermissionError(13, "in use")
        remove(path, missing_ok)

    monkeypatch.setattr(type(kept[0]), "unlink", refuse)
    shown = haptix_cli("cache", "--clear")
    assert shown.code == 2
    assert f"{KEY}.surface: in use" in shown.err
    assert [file for file in kept if file.exists()] == kept[:1]


def test_a_cache_that_cannot_be_read_is_told(haptix_cli, kept, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(type(kept[0]), "iterdir", refuse)
    shown = haptix_cli("cache")
    assert shown.code == 2
    assert f"cannot read {kept[0].parent}: Permission denied" in shown.err


def test_a_folder_that_others_can_write_is_left_alone(haptix_cli, places, kept):
    # Whoever can put files there chooses what is removed.
    places["second"].chmod(0o777)
    assert by_kind(haptix_cli("cache", "--clear", "--json"))["compiled firmware"]["files"] == 2
    assert kept[-1].exists()


def test_what_the_commands_keep_is_listed(haptix_cli, places, model):
    # The names in the tests above are made up; these are not.
    from haptix.surface import cached_surface

    cached_surface(model, {"normal_force_n": 0.5, "voltage_v": (0.0, 50.0)}, 0.01)
    if build.find_compiler():
        build._compile(build.find_compiler(), places["compiled"] / build.file_name("0" * 16))
    rows = by_kind(haptix_cli("cache", "--json"))
    assert rows["surfaces"]["files"] == 1
    assert rows["compiled firmware"]["files"] == (2 if build.find_compiler() else 0)
    everything = [file for folder in places.values() for file in folder.rglob("*")]
    assert sum(row["files"] for row in rows.values()) == len(everything)
