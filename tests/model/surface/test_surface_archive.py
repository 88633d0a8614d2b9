"""Export to NetCDF, as another program reads it."""

import json
import sys
from pathlib import Path

import pytest
import torch

from haptix import FrictionSurface, HaptixError
from haptix.base.errors import FileFormatError
from haptix.tasks.cli import main


@pytest.fixture
def xarray():
    """The package with which the files are read back."""
    pytest.importorskip("h5netcdf")
    return pytest.importorskip("xarray")


@pytest.fixture
def saved(plain: FrictionSurface, tmp_path: Path) -> Path:
    path = tmp_path / "my.surface"
    plain.save(path)
    return path


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("which", ["full", "plain", "past_pull_in"])
def test_the_numbers_and_their_places(
    which: str, dtype: torch.dtype, xarray, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    surface: FrictionSurface = request.getfixturevalue(which).to(dtype)
    path = tmp_path / "new folder" / "my.nc"
    surface.to_netcdf(path)
    with xarray.open_dataset(path, engine="h5netcdf") as read:
        assert list(read.sizes) == ["normal_force_n", "frequency_hz", "h0_m", "drive"]
        assert set(read.data_vars) == {"mu", "pull_in_voltage_v", "breakdown_voltage_v"}
        for axis in surface.table.axes:
            nodes = torch.tensor(read[axis.name].values)
            torch.testing.assert_close(nodes, axis.nodes, rtol=0, atol=0, equal_nan=True)
        assert torch.equal(torch.tensor(read.drive.values), surface.table.drive)
        assert torch.equal(torch.tensor(read.mu.values), surface.mu_table)
        for name in ("pull_in_voltage_v", "breakdown_voltage_v"):
            stored = torch.tensor(read[name].values)
            assert torch.equal(stored, getattr(surface.table, name))
        assert read.voltage_limit_v == surface.voltage_limit_v
        assert json.loads(read.haptix_info) == json.loads(json.dumps(surface.info))


@pytest.mark.parametrize("which", ["full", "plain", "past_pull_in"])
def test_a_surface_comes_back_from_its_arrays(
    which: str, xarray, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    surface: FrictionSurface = request.getfixturevalue(which)
    surface.to_netcdf(tmp_path / "my.nc")
    with xarray.open_dataset(tmp_path / "my.nc", engine="h5netcdf") as read:
        both = FrictionSurface.from_xarray(surface.to_xarray()), FrictionSurface.from_xarray(read)
    for again in both:
        # 1/mu and the logarithms are taken twice: some roundings of float64.
        near = {"rtol": 1e-12, "atol": 1e-12}
        torch.testing.assert_close(again.table.columns, surface.table.columns, **near)
        assert again.table.axes == surface.table.axes
        assert again.table.limited_by == surface.table.limited_by
        assert again.voltage_limit_v == surface.voltage_limit_v
        assert again.info == json.loads(json.dumps(surface.info))


def test_arrays_of_others_are_no_surface(xarray) -> None:
    with pytest.raises(FileFormatError, match="dataset"):
        FrictionSurface.from_xarray(xarray.Dataset({"mu": ("x", [1.0, 2.0])}))


def test_a_dataset_that_no_build_makes_is_refused(plain: FrictionSurface, xarray) -> None:
    good = plain.to_xarray()
    changed = {
        "friction is finite and above 0": good.assign(mu=-good["mu"]),
        "nodes increase": good.isel(normal_force_n=slice(None, None, -1)),
        "voltages are above 0": good.assign_attrs(voltage_limit_v=-5.0),
    }
    for why, dataset in changed.items():
        with pytest.raises(FileFormatError, match=why):
            FrictionSurface.from_xarray(dataset)
    with pytest.raises(FileFormatError, match="dataset"):
        FrictionSurface.from_xarray(good.isel(h0_m=0))


def test_a_number_that_is_read_is_the_friction_there(
    full: FrictionSurface, xarray, tmp_path: Path
) -> None:
    full.to_netcdf(tmp_path / "my.nc")
    with xarray.open_dataset(tmp_path / "my.nc", engine="h5netcdf") as read:
        column = read.sel(normal_force_n=0.9, frequency_hz=60.0, h0_m=1e-7)
        voltage = column.pull_in_voltage_v * column.drive**0.5
        for point in range(len(column.drive)):
            at = float(voltage[point])
            if at < full.voltage_limit_v:
                mu = full.mu(0.9, at, 60.0, 1e-7)
                assert float(mu) == pytest.approx(float(column.mu[point]), rel=1e-12)


def test_units_and_names(full: FrictionSurface, xarray, tmp_path: Path) -> None:
    full.to_netcdf(tmp_path / "my.nc")
    with xarray.open_dataset(tmp_path / "my.nc", engine="h5netcdf") as read:
        units = {name: variable.attrs["units"] for name, variable in read.variables.items()}
        assert all(variable.attrs["long_name"] for variable in read.variables.values())
        assert not any("_FillValue" in variable.encoding for variable in read.variables.values())
    volts = {"pull_in_voltage_v": "V", "breakdown_voltage_v": "V"}
    places = {"normal_force_n": "N", "frequency_hz": "Hz", "h0_m": "m"}
    assert units == {**places, **volts, "drive": "1", "mu": "1"}


def test_texts_are_characters_that_every_reader_knows(
    full: FrictionSurface, tmp_path: Path
) -> None:
    """NetCDF's NC_CHAR is a text of fixed length in HDF5; octave-netcdf 1.0.16 reads no other."""
    h5py = pytest.importorskip("h5py", reason="the extra netcdf is not installed")
    full.to_netcdf(tmp_path / "my.nc")
    with h5py.File(tmp_path / "my.nc") as file:
        for part in (file, *(file[name] for name in file)):
            for name in part.attrs:
                if (text := h5py.check_string_dtype(part.attrs.get_id(name).dtype)) is not None:
                    assert text.length is not None, name
        assert "not for interp" in str(file["mu"].attrs["comment"])


def test_the_same_surface_gives_the_same_bytes(
    full: FrictionSurface, plain: FrictionSurface, xarray, tmp_path: Path
) -> None:
    for name in ("a.nc", "b.nc"):
        plain.to_netcdf(tmp_path / "b.nc")  # which is replaced
        full.to_netcdf(tmp_path / name)
    assert (tmp_path / "a.nc").read_bytes() == (tmp_path / "b.nc").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.nc", "b.nc"]


@pytest.mark.parametrize("package", ["xarray", "h5netcdf"])
def test_a_package_that_is_not_installed(
    package: str, plain: FrictionSurface, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("h5netcdf")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(HaptixError, match=rf"{package}, which is not installed.*pip.*\[netcdf\]"):
        plain.to_netcdf(tmp_path / "my.nc")
    assert list(tmp_path.iterdir()) == []


def test_places_that_cannot_be_written(plain: FrictionSurface, xarray, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "file" / "my.nc", tmp_path / "folder"):
        with pytest.raises(FileFormatError, match=f"cannot write {path}"):
            plain.to_netcdf(path)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "folder"]


def test_a_failed_export_leaves_the_old_file_whole(
    plain: FrictionSurface, xarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "my.nc"
    path.write_text("old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(FileFormatError, match="No space left"):
        plain.to_netcdf(path)
    monkeypatch.undo()
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["my.nc"]


def haptix(*arguments: object) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["haptix", *map(str, arguments)])
        main()


def test_the_command(
    saved: Path, plain: FrictionSurface, xarray, capsys: pytest.CaptureFixture[str]
) -> None:
    out = saved.with_name("my.nc")
    with pytest.raises(SystemExit) as end:
        haptix("export", saved, out, "--json")
    assert end.value.code == 0
    told = [{"file": str(out), "values": plain.mu_table.numel(), "bytes": out.stat().st_size}]
    assert json.loads(capsys.readouterr().out) == told
    with xarray.open_dataset(out, engine="h5netcdf") as read:
        assert torch.equal(torch.tensor(read.mu.values), plain.mu_table)


def test_the_command_replaces_only_when_told_to(
    saved: Path, xarray, capsys: pytest.CaptureFixture[str]
) -> None:
    out = saved.with_name("my.nc")
    out.write_text("old")
    with pytest.raises(SystemExit) as end:
        haptix("export", saved, out)
    assert end.value.code == 2
    assert "my.nc exists: name another file, or pass --overwrite" in capsys.readouterr().err
    assert out.read_text() == "old"
    with pytest.raises(SystemExit) as end:
        haptix("export", saved, out, "--overwrite")
    assert end.value.code == 0
    assert xarray.open_dataset(out, engine="h5netcdf").mu.size > 0


def test_the_command_with_what_is_no_surface(
    saved: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for content in (b"hello", saved.read_bytes()[:-5]):
        saved.write_bytes(content)
        with pytest.raises(SystemExit) as end:
            haptix("export", saved, saved.with_name("my.nc"))
        assert end.value.code == 2
        assert "not a friction surface, or is damaged" in capsys.readouterr().err
    assert [entry.name for entry in saved.parent.iterdir()] == ["my.surface"]
