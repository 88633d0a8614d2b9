"""``haptix cache``: it lists what can be made again, removes that, and nothing else."""

import json

import pytest

KEY = "0123456789abcdef" * 4


@pytest.fixture
def kept(private_cache):
    keys = KEY, KEY[::-1], 64 * "0"
    files = [private_cache / "results" / key[:2] / key / "friction.surface" for key in keys]
    for file in files:
        file.parent.mkdir(parents=True)
        file.write_bytes(b"x" * 1000)
    return files


@pytest.fixture
def others(private_cache):
    """What a person may have put beside them."""
    files = [
        private_cache / "my.surface",
        private_cache / f"{KEY}.nc",
        private_cache / f".my.surface.{KEY[:16]}.part",
        private_cache / "results" / KEY[:2] / "notes.txt",
    ]
    for file in files:
        file.write_bytes(b"mine")
    return files


def by_kind(shown):
    assert shown.code == 0, shown.err
    return {row["kept"]: row for row in json.loads(shown.out)}


def test_it_lists_what_is_kept_and_where(haptix_cli, kept, others, private_cache):
    rows = by_kind(haptix_cli("cache", "--json"))
    assert list(rows) == ["surfaces"]
    assert rows["surfaces"]["files"] == 3
    assert rows["surfaces"]["bytes"] == 3000
    assert rows["surfaces"]["folder"] == str(private_cache)
    assert all(file.exists() for file in (*kept, *others))
    assert "surfaces" in haptix_cli("cache").out


def test_it_clears_that_and_nothing_else(haptix_cli, kept, others):
    assert by_kind(haptix_cli("cache", "--clear", "--json"))["surfaces"]["files"] == 3
    assert not any(file.exists() for file in kept) and not kept[0].parent.exists()
    assert all(file.read_bytes() == b"mine" for file in others)
    assert by_kind(haptix_cli("cache", "--json"))["surfaces"]["files"] == 0


def test_without_a_cache_there_is_nothing_to_clear(haptix_cli, private_cache):
    assert by_kind(haptix_cli("cache", "--clear", "--json"))["surfaces"]["files"] == 0
    assert not private_cache.exists()


def test_a_file_in_use_is_told_and_all_others_go(haptix_cli, kept, monkeypatch):
    remove = type(kept[0]).unlink

    def refuse(path, missing_ok=False):
        if path == kept[1]:
            raise PermissionError(13, "in use")
        remove(path, missing_ok)

    monkeypatch.setattr(type(kept[0]), "unlink", refuse)
    shown = haptix_cli("cache", "--clear")
    assert shown.code == 2
    assert f"{kept[1]}: in use" in " ".join(shown.err.split())
    assert [file for file in kept if file.exists()] == kept[1:2]


def test_a_cache_that_cannot_be_read_is_told(haptix_cli, kept, private_cache, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(type(kept[0]), "iterdir", refuse)
    shown = haptix_cli("cache")
    assert shown.code == 2
    assert f"cannot read {private_cache}: Permission denied" in shown.err


def test_what_the_commands_keep_is_listed(haptix_cli, private_cache, model):
    # The names in the tests above are made up; these are not.
    from haptix.model.surface import cached_surface

    cached_surface(model, {"normal_force_n": 0.5, "voltage_v": (0.0, 50.0)}, 0.01)
    assert by_kind(haptix_cli("cache", "--json"))["surfaces"]["files"] == 2
    assert [path.name for path in private_cache.rglob("*.*")] == ["friction.surface", "result.json"]
