"""The surface file: round trips, damage of every kind, and writing whole or not at all."""

import hashlib
import json
import os
import pickle
import struct
import threading
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load as load_tensors
from safetensors.torch import save as to_bytes
from safetensors.torch import save_file

from haptix import ContactModel, Finger, FrictionSurface, Screen
from haptix.base.errors import FileFormatError
from haptix.base.files import digest
from haptix.model.surface.file import surface_key


@pytest.fixture(scope="module")
def data(full: FrictionSurface, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "a.surface"
    full.save(path)
    return path.read_bytes()


def split(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The safetensors header as JSON, and the bytes of the tensors."""
    (length,) = struct.unpack("<Q", data[:8])
    return json.loads(data[8 : 8 + length]), data[8 + length :]


def join(header: dict[str, Any], body: bytes) -> bytes:
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    return struct.pack("<Q", len(text)) + text + body


def with_metadata(data: bytes, **changes: Any) -> bytes:
    header, body = split(data)
    own = json.loads(header["__metadata__"]["haptix"])
    own.update(changes)
    header["__metadata__"]["haptix"] = json.dumps(own)
    return join(header, body)


def load(tmp_path: Path, data: bytes) -> FrictionSurface:
    path = tmp_path / "some.surface"
    path.write_bytes(data)
    return FrictionSurface.load(path)


def test_what_overwrites_the_file_in_place_changes_no_loaded_surface(
    tmp_path: Path, data: bytes
) -> None:
    """Such as `cp` of another surface: its bytes are no surface until it has ended."""
    surface = load(tmp_path, data)
    columns = surface.table.columns.clone()
    with (tmp_path / "some.surface").open("r+b") as file:
        file.write(b"\xc0" * len(data))
    assert torch.equal(surface.table.columns, columns)


@pytest.mark.parametrize("which", ["full", "plain", "past_pull_in"])
def test_a_loaded_surface_is_the_saved_one(
    which: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    surface: FrictionSurface = request.getfixturevalue(which)
    path = tmp_path / "new folder" / "my.surface"
    surface.save(path)
    loaded = FrictionSurface.load(path)
    assert torch.equal(loaded.mu_table, surface.mu_table)
    ours, theirs = loaded.table, surface.table
    assert torch.equal(ours.pull_in_voltage_v, theirs.pull_in_voltage_v)
    assert torch.equal(ours.breakdown_voltage_v, theirs.breakdown_voltage_v)
    assert torch.equal(ours.drive, theirs.drive)
    assert ours.limited_by == theirs.limited_by
    for a, b in zip(ours.axes, theirs.axes, strict=True):
        assert a.name == b.name
        assert torch.equal(a.nodes.nan_to_num(-1.0), b.nodes.nan_to_num(-1.0))
        assert a.is_absent == b.is_absent
    assert loaded.voltage_limit_v == surface.voltage_limit_v
    # JSON has lists for tuples, and nothing else changes.
    assert loaded.info == json.loads(json.dumps(surface.info))


def test_the_same_surface_gives_the_same_bytes(
    full: FrictionSurface, data: bytes, tmp_path: Path
) -> None:
    full.save(tmp_path / "again.surface")
    assert (tmp_path / "again.surface").read_bytes() == data
    load(tmp_path, data).save(tmp_path / "copied.surface")
    assert (tmp_path / "copied.surface").read_bytes() == data


def test_single_precision_and_slices_are_saved_too(full: FrictionSurface, tmp_path: Path) -> None:
    small = full.at(137.0, 1.7e-7).to(torch.float32)
    small.save(tmp_path / "small.surface")
    loaded = FrictionSurface.load(tmp_path / "small.surface")
    assert loaded.mu_table.dtype == torch.float32
    assert torch.equal(loaded.mu(0.5, 70.0), small.mu(0.5, 70.0))


def test_the_header_says_what_the_file_holds(data: bytes) -> None:
    header = json.loads(split(data)[0]["__metadata__"]["haptix"])
    units = {"normal_force_n": "N", "frequency_hz": "Hz", "h0_m": "m"}
    assert units.items() <= header["units"].items()
    assert header["axes"] == [*units, "drive"]
    assert header["monotone_axis"] == "drive"
    assert header["info"]["error_max"] <= header["info"]["tolerance"]["value"]
    assert header["info"]["error_p99"] <= header["info"]["error_max"]
    assert header["info"]["monotone_corrections"] == 0
    assert header["info"]["model"]["contact_spots"] == "widened"
    accuracy = header["info"]["accuracy"]
    assert 0 < accuracy["ratio_percent"] < accuracy["mu_percent"]
    assert header["info"]["model"]["finger"]["dielectric"]["is_placeholder"] is True


@pytest.mark.parametrize("share", [0.0, 1e-4, 0.01, 0.3, 0.9, 0.9999])
def test_truncated_files(data: bytes, share: float, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"some\.surface"):
        load(tmp_path, data[: int(share * len(data))])


def test_files_that_lack_one_byte_or_have_one_too_many(data: bytes, tmp_path: Path) -> None:
    for wrong in (data[:-1], data[1:], data + b"\0", data[:7], data[:8]):
        with pytest.raises(FileFormatError):
            load(tmp_path, wrong)


@pytest.mark.parametrize("at", [0.0, 0.2, 0.5, 0.999])
@pytest.mark.parametrize("bit", [0, 7])
def test_one_flipped_bit_in_the_numbers(data: bytes, at: float, bit: int, tmp_path: Path) -> None:
    body = len(split(data)[1])
    position = len(data) - body + int(at * body)
    damaged = bytearray(data)
    damaged[position] ^= 1 << bit
    with pytest.raises(FileFormatError, match="damaged"):
        load(tmp_path, bytes(damaged))


def test_one_flipped_bit_in_the_header(data: bytes, tmp_path: Path) -> None:
    # The lowest bit changes every digit, letter and mark to another one.
    length = len(data) - len(split(data)[1])
    whole, accepted = load(tmp_path, data), []
    for position in range(0, length, 61):
        damaged = bytearray(data)
        damaged[position] ^= 1
        try:
            loaded = load(tmp_path, bytes(damaged))
        except FileFormatError:
            continue
        # The last digit of a float may read as the same number: then nothing is damaged.
        if loaded.info != whole.info or loaded.voltage_limit_v != whole.voltage_limit_v:
            accepted.append(data[position - 20 : position + 20])
    assert accepted == []


@pytest.mark.parametrize("changes", [{"voltage_limit_v": 151.0}, {"info": {}}])
def test_a_header_that_was_edited(data: bytes, changes: dict[str, Any], tmp_path: Path) -> None:
    load(tmp_path, with_metadata(data))
    with pytest.raises(FileFormatError, match="damaged"):
        load(tmp_path, with_metadata(data, **changes))


def test_damaged_length_of_the_header(data: bytes, tmp_path: Path) -> None:
    for byte in range(8):
        damaged = bytearray(data)
        damaged[byte] ^= 0xFF
        with pytest.raises(FileFormatError):
            load(tmp_path, bytes(damaged))


FOREIGN = {
    "empty": b"",
    "text": b"normal_force_n = 1\n" * 20,
    "JSON": b'{"mu": 1}',
    "pickle": pickle.dumps({"mu": [1.0]}),
    "zeros": bytes(1000),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_files_of_another_kind(name: str, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="damaged"):
        load(tmp_path, FOREIGN[name])


class Trap:
    """Unpickling this makes a folder."""

    def __init__(self, path: Path) -> None:
        self.path = str(path)

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.mkdir, (self.path,)


@pytest.mark.parametrize("writer", [pickle.dumps, None])
def test_nothing_in_a_file_is_executed(writer: Any, tmp_path: Path) -> None:
    path = tmp_path / "trap.surface"
    trap = Trap(tmp_path / "sprung")
    if writer is None:
        torch.save(trap, path)
    else:
        path.write_bytes(writer(trap))
    with pytest.raises(FileFormatError):
        FrictionSurface.load(path)
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize(
    "metadata", [None, {"haptix": "null"}, {"haptix": "[1]"}, {"format": "pt"}]
)
def test_safetensors_of_others(metadata: dict[str, str] | None, tmp_path: Path) -> None:
    path = tmp_path / "weights.safetensors"
    save_file({"mu": torch.ones(3)}, path, metadata=metadata)
    with pytest.raises(FileFormatError, match="not a friction surface"):
        FrictionSurface.load(path)


def test_metadata_that_is_not_json(tmp_path: Path) -> None:
    path = tmp_path / "weights.safetensors"
    save_file({"mu": torch.ones(3)}, path, metadata={"haptix": "{"})
    with pytest.raises(FileFormatError):
        FrictionSurface.load(path)


@pytest.mark.parametrize("version", [1, "3.0", "20.0", None, 0])
def test_other_versions(data: bytes, version: Any, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="version 2"):
        load(tmp_path, with_metadata(data, version=version))


def test_a_later_minor_version_is_read(data: bytes, tmp_path: Path) -> None:
    header, _ = split(data)
    own = json.loads(header["__metadata__"]["haptix"])
    own.pop("sha256")
    own |= {"version": "2.9", "something new": [1, 2]}
    digest = hashlib.sha256(json.dumps(own, sort_keys=True).encode()).hexdigest()
    loaded = load(tmp_path, with_metadata(data, **own, sha256=digest))
    assert loaded.info["tolerance_met"] is True


def test_a_surface_from_before_an_axis_was_added(data: bytes, tmp_path: Path) -> None:
    tensors, header = load_tensors(data), json.loads(split(data)[0]["__metadata__"]["haptix"])
    del tensors["h0_m"], header["crc32"]["h0_m"], header["sha256"]
    header["axes"].remove("h0_m")
    text = json.dumps(header | {"sha256": digest(header)})
    with pytest.raises(FileFormatError, match="axes") as refusal:
        load(tmp_path, to_bytes(tensors, metadata={"haptix": text}))
    assert "h0_m" in str(refusal.value)


def test_the_fingers_response_is_kept_beside_the_numbers(
    model: ContactModel, tmp_path: Path
) -> None:
    slow = ContactModel(model.finger.replace(response_hz_per_mm_per_s=9.0), model.screen)
    scene = {"normal_force_n": 0.5, "h0_m": 2e-7}
    FrictionSurface.build(slow, scene, tolerance=1e-2).save(tmp_path / "slow.surface")
    # It is no number of the model's, so that the model of the preset is the same one.
    loaded = FrictionSurface.load(tmp_path / "slow.surface", model)
    assert loaded.response_hz_per_mm_per_s == 9.0
    # In a cache they are two.
    assert loaded.info["key"] == surface_key(slow, scene, 1e-2) != surface_key(model, scene, 1e-2)


def test_a_surface_that_says_less_is_to_be_built_again(
    full: FrictionSurface, tmp_path: Path
) -> None:
    path = tmp_path / "less.surface"
    less = {
        name: value for name, value in full.info.items() if name not in ("accuracy", "intervals")
    }
    FrictionSurface(full.table, less).save(path)
    with pytest.raises(FileFormatError, match="intervals as well; build the surface again"):
        FrictionSurface.load(path)


def test_the_model_that_is_named(full: FrictionSurface, data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "some.surface"
    path.write_bytes(data)
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    same = FrictionSurface.load(path, ContactModel(finger, screen))
    assert torch.equal(same.mu_table, full.mu_table)
    for other in (
        ContactModel(finger.replace(youngs_modulus_pa=41e6), screen),
        ContactModel(finger, screen, terms={"finite-size": False}),
        ContactModel(finger, screen, contact_spots="included"),
    ):
        with pytest.raises(FileFormatError, match="another model"):
            FrictionSurface.load(path, other)


def test_two_processes_that_save_at_once(full: FrictionSurface, tmp_path: Path) -> None:
    path = tmp_path / "shared.surface"
    small = full.at(137.0, 1.7e-7)
    halt = threading.Event()

    def save_often(surface: FrictionSurface) -> None:
        while not halt.is_set():
            surface.save(path)

    full.save(path)
    threads = [threading.Thread(target=save_often, args=(s,)) for s in (full, small)]
    for thread in threads:
        thread.start()
    try:
        sizes = {FrictionSurface.load(path).mu_table.numel() for _ in range(60)}
    finally:
        halt.set()
        for thread in threads:
            thread.join()
    assert sizes <= {full.mu_table.numel(), small.mu_table.numel()}
    assert [p.name for p in tmp_path.iterdir()] == ["shared.surface"]


@pytest.mark.parametrize(
    "changes",
    [
        {"format": "other"},
        {"sha256": "0" * 64},
        {"sha256": None},
        {"voltage_limit_v": "high"},
        {"voltage_limit_v": None},
        {"voltage_limit_v": float("nan")},
        {"voltage_limit_v": -1.0},
        {"info": None},
        {"info": 3},
    ],
)
def test_contradictory_headers(data: bytes, changes: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(FileFormatError):
        load(tmp_path, with_metadata(data, **changes))


def test_missing_files_and_folders(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"none\.surface.*haptix build"):
        FrictionSurface.load(tmp_path / "none.surface")
    with pytest.raises(FileFormatError):
        FrictionSurface.load(tmp_path)


@pytest.mark.parametrize("step", ["write", "move"])
def test_a_failed_save_leaves_the_old_file_whole(
    step: str,
    full: FrictionSurface,
    plain: FrictionSurface,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / "kept.surface"
    plain.save(path)
    before = path.read_bytes()

    def fail(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    if step == "write":
        monkeypatch.setattr(Path, "open", fail)
    else:
        monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises((FileFormatError, OSError), match="No space left"):
        full.save(path)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["kept.surface"]
    assert torch.equal(FrictionSurface.load(path).mu_table, plain.mu_table)


def test_a_folder_that_cannot_be_made(full: FrictionSurface, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(FileFormatError, match="cannot write"):
        full.save(tmp_path / "file" / "my.surface")


def test_others_may_read_a_saved_surface(full: FrictionSurface, tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        full.save(tmp_path / "my.surface")
    finally:
        os.umask(before)
    assert (tmp_path / "my.surface").stat().st_mode & 0o777 == 0o644


def test_saving_replaces(full: FrictionSurface, plain: FrictionSurface, tmp_path: Path) -> None:
    path = tmp_path / "my.surface"
    full.save(path)
    plain.save(path)
    assert torch.equal(FrictionSurface.load(path).mu_table, plain.mu_table)
    assert len(list(tmp_path.iterdir())) == 1
