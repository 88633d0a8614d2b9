"""`haptix finger`: real files of measurements in, a finger and a picture out."""

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import haptix
from haptix.base.errors import FileFormatError, InputError
from haptix.model.contact import RoughnessSpectrum
from haptix.model.contact.measured_files import MeasuredTable, read_spectrum, read_surface
from haptix.model.electro import SkinDielectric

POINTS, PIXEL_M, RMS_M = 200, 2e-5, 13e-6
X_M = np.arange(POINTS) * PIXEL_M
RIDGES_M = np.tile(math.sqrt(2) * RMS_M * np.sin(2 * math.pi * X_M / 0.4e-3), (POINTS, 1))
FRACTION = 0.995  # a plane takes a little of the ridges


def made(haptix_cli: Any, *arguments: object) -> Any:
    shown = haptix_cli("finger", *arguments, "--json")
    assert shown.code == 0, shown.err
    return json.loads(shown.out)


def text_of(names: str, *columns: Any, between: str = ",", comma: bool = False) -> str:
    rows = [between.join(f"{x:.9g}" for x in row) for row in zip(*columns, strict=True)]
    text = "\n".join(rows) + "\n"
    return names + ("\n" if names else "") + (text.replace(".", ",") if comma else text)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    um = RIDGES_M * 1e6
    np.save(tmp_path / "map.npy", um)
    (tmp_path / "german.csv").write_text(text_of("", *um.T, between=";", comma=True))
    (tmp_path / "scan.csv").write_text(text_of("x (mm),z (um)", X_M * 1e3, um[0]))
    (tmp_path / "scan.txt").write_text(
        text_of("# x [um]\tz [nm]", X_M * 1e6, um[0] * 1e3, between="\t")
    )
    return tmp_path


@pytest.mark.parametrize(
    "arguments",
    [
        ["map.npy", "--unit", "um", "--pixel-m", "20um"],
        ["german.csv", "--unit", "um", "--pixel-m", "0.02 mm"],
        ["scan.csv"],
        ["scan.txt", "scan.csv"],
        ["map.nc"],
    ],
)
def test_a_finger_of_each_kind_of_file(
    haptix_cli: Any, files: Path, monkeypatch: Any, arguments: list[str]
) -> None:
    monkeypatch.chdir(files)
    if "map.nc" in arguments:
        topography = pytest.importorskip("SurfaceTopography", reason="the extra topography")
        side_um = POINTS * PIXEL_M * 1e6
        topography.Topography(RIDGES_M * 1e6, (side_um, side_um), unit="um").to_netcdf("map.nc")
    pytest.importorskip("matplotlib", reason="the extra figures")
    told = made(haptix_cli, *arguments)
    assert told["h_rms_m"] == pytest.approx(RMS_M * FRACTION, rel=0.01)
    assert told["shortest_measured_m"] == pytest.approx(2 * PIXEL_M, rel=1e-6)
    assert told["longest_measured_m"] == pytest.approx(POINTS * PIXEL_M, rel=1e-6)
    assert any("waves shorter than 40 um" in note for note in told["notes"])
    finger = haptix.Finger.load("finger.toml")
    assert float(finger.roughness.spectrum().h_rms_m) == pytest.approx(told["h_rms_m"], rel=1e-9)
    assert finger.youngs_modulus_pa == haptix.Finger.preset("semi-wet").youngs_modulus_pa
    assert Path("finger.png").stat().st_size > 10_000
    again = haptix_cli("finger", *arguments)
    assert again.code == 2 and "finger.toml exists" in again.err


@pytest.mark.slow
def test_waves_that_were_not_seen_stay_marked_and_are_added_on_request(
    haptix_cli: Any, files: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(files)
    law = haptix.Finger.preset("semi-wet").roughness.spectrum()
    q = torch.tensor([1e3, law.q_rolloff, 3.14e5], dtype=torch.float64)
    Path("c.csv").write_text(text_of("q (1/um),C_iso (um^4)", q / 1e6, law(q) * 4e24 * math.pi**2))
    arguments = ["c.csv", "--convention", "C_iso", "--h-rms-m", "22um", "--overwrite"]
    frictions = []
    for more in ([], ["--hurst", "0.86"]):
        made(haptix_cli, *arguments, *more)
        shown = haptix_cli(
            "query", "--finger", "finger.toml", "--normal-force-n", "0.5", "--voltage-v", "0"
        )
        text = " ".join(shown.out.split())
        assert "h_rms 22 um" in text and "waves shorter than 20 um" in text
        model = haptix.ContactModel(haptix.Finger.load("finger.toml"), haptix.Screen())
        frictions.append(float(model.solve(0.5, 0.0).mu))
    whole = haptix.ContactModel(haptix.Finger.preset("semi-wet"), haptix.Screen())
    assert frictions[0] > 3 * frictions[1]  # 10 um pixels see a quarter of the slope
    assert frictions[1] == pytest.approx(float(whole.solve(0.5, 0.0).mu), rel=1e-4)
    Path("fine.csv").write_text(
        text_of(
            "q (1/m),C (m^4)",
            [1e3, law.q_rolloff, 2e7],
            law(law.wavenumber.new_tensor([1e3, law.q_rolloff, 2e7])),
        )
    )
    told = made(haptix_cli, "fine.csv", "--convention", "C", "--overwrite")
    assert not any("waves" in note for note in told["notes"] if "not measured" in note)


def test_the_wrong_convention_and_files_of_another_kind(haptix_cli: Any, files: Path) -> None:
    law = haptix.Finger.preset("semi-wet").roughness.spectrum()
    spectrum, three, empty = (files / name for name in ("c.csv", "three.csv", "empty.txt"))
    spectrum.write_text(
        text_of("q (1/m),C_iso (m^4)", law.wavenumber, law.density * 4 * math.pi**2)
    )
    three.write_text(text_of("a,b,c", X_M, X_M, X_M))
    empty.write_text("nothing here\n")
    known = ["--h-rms-m", "22um"]
    for arguments, sentence in (
        ([spectrum, "--convention", "C", *known], r'convention = "C_iso" it would be the same'),
        ([spectrum], "name its convention"),
        ([files / "scan.csv", "--convention", "C"], "expected a unit such as /m"),
        ([files / "map.npy", "--pixel-m", "20um"], "does not state the unit"),
        ([files / "map.npy", "--unit", "um"], "pixel_m"),
        ([files / "map.npy", files / "scan.csv", "--unit", "um", "--pixel-m", "20um"], "one map"),
        ([three, "--unit", "um"], "two columns"),
        ([empty], "rows of numbers|SurfaceTopography"),
        ([], "--dielectric"),
    ):
        shown = haptix_cli("finger", *arguments, "--out", files / "x.toml")
        assert shown.code == 2, arguments
        assert re.search(sentence, shown.err), shown.err
        assert not (files / "x.toml").exists()


def test_columns_of_other_programs() -> None:
    table = MeasuredTable.of('"f";"Cs";"D"\n"Hz";"nF";\n1,5;2;0,25\n3;4;0,5\n', "text")
    assert table.names == ("f", "Cs", "D") and table.units == ("Hz", "nF", "")
    assert table.values.tolist() == [[1.5, 2, 0.25], [3, 4, 0.5]]
    assert table.column(1, "F").tolist() == [2e-9, 4e-9]
    table = MeasuredTable.of("# made by hand\n# q (1/um) C_iso [um^4]\n1 2\n2 nan\n", "text")
    assert table.names == ("q", "C_iso") and table.units == ("1/um", "um^4")
    with pytest.raises(FileFormatError, match="line 4: expected 2 numbers"):
        MeasuredTable.of("a,b\n1,2\n3,4\n5\n", "text")
    with pytest.raises(InputError, match="a: expected a unit such as m, got kg"):
        MeasuredTable.of("a (kg),b\n1,2\n3,4\n", "text").column(0, "m")


LAYER_M2, LAYER_M = 2e-4, 2e-5


@pytest.mark.parametrize(
    "form", ["sigma", "rho", "tan", "Z", "RX", "CpRp", "CpG", "CpD", "CsRs", "CsD"]
)
def test_dielectric_tables_of_the_literature_and_of_meters(tmp_path: Path, form: str) -> None:
    f = np.geomspace(1e2, 1e6, 9)
    omega, skin = 2 * math.pi * f, SkinDielectric()
    eps = skin.relative_permittivity(torch.from_numpy(f)).numpy()
    vacuum = 8.8541878128e-12
    sigma = eps.imag * omega * vacuum
    admittance = (sigma + 1j * omega * vacuum * eps.real) * LAYER_M2 / LAYER_M
    ohm = 1 / admittance
    cp, cs = admittance.imag / omega, -1 / (omega * ohm.imag)
    names, *columns = {
        "sigma": ("Frequency (Hz),Conductivity (S/m),Relative permittivity", f, sigma, eps.real),
        "rho": ("f (kHz),eps_r,rho (kOhm m)", f / 1e3, eps.real, 1e-3 / sigma),
        "tan": ("freq_Hz,permittivity,loss tangent", f, eps.real, eps.imag / eps.real),
        "Z": ("f [Hz],|Z| [kOhm],Theta [rad]", f, abs(ohm) / 1e3, np.angle(ohm)),
        "RX": ("f,R,X", f, ohm.real, ohm.imag),
        "CpRp": ("f (Hz),Cp (nF),Rp (MOhm)", f, cp * 1e9, 1e-6 / admittance.real),
        "CpG": ("f (Hz),Cp (nF),G (uS)", f, cp * 1e9, admittance.real * 1e6),
        "CpD": ("f (Hz),Cp (pF),D", f, cp * 1e12, admittance.real / admittance.imag),
        "CsRs": ("f (Hz),Cs (F),Rs (Ohm)", f, cs, ohm.real),
        "CsD": ("f,Cs,D\nHz,nF,", f, cs * 1e9, -ohm.real / ohm.imag),
    }[form]
    file = tmp_path / "table.csv"
    file.write_text(text_of(names, *(column[::-1] for column in columns)))
    read = SkinDielectric.read(file, LAYER_M2, LAYER_M)
    at = torch.from_numpy(f)
    torch.testing.assert_close(
        read.relative_permittivity(at), torch.from_numpy(eps), rtol=1e-7, atol=0
    )
    assert not read.is_placeholder and read.source == "table.csv" and read.law == "refuse"
    if form[0] in "ZRC":
        with pytest.raises(InputError, match="area"):
            SkinDielectric.read(file)


def test_a_finger_of_a_dielectric_table_refuses_drives_outside_it(
    haptix_cli: Any, tmp_path: Path
) -> None:
    f = np.geomspace(1e3, 1e6, 7)
    eps = SkinDielectric().relative_permittivity(torch.from_numpy(f)).numpy()
    table = tmp_path / "gabriel.csv"
    sigma = eps.imag * 2 * math.pi * f * 8.8541878128e-12
    table.write_text(text_of("f (Hz),permittivity,sigma (S/m)", f, eps.real, sigma))
    out = tmp_path / "finger.toml"
    query = ("query", "--finger", out, "--normal-force-n", "0.5", "--voltage-v", "0,200", "--json")
    for law, code in (("refuse", 2), ("power-law", 0)):
        told = made(haptix_cli, "--dielectric", table, "--beyond", law, "--out", out, "--overwrite")
        assert told["dielectric_hz"] == "1000 to 1e+06" and "h_rms_m" not in told
        assert not any("dielectric of the skin" in note for note in told["notes"])
        shown = haptix_cli(*query, "--frequency-hz", "125")
        assert shown.code == code, shown.err
        assert haptix_cli(*query, "--frequency-hz", "4000").code == 0
    off, on = (row["mu"] for row in json.loads(haptix_cli(*query, "--frequency-hz", "125").out))
    # The whole table gives 1.720, held values 2.346. Permittivity bends over three octaves.
    assert on / off == pytest.approx(1.720, rel=0.05)


def test_text_that_a_page_sends(tmp_path: Path) -> None:
    from haptix.base.task import Context
    from haptix.tasks.fingers import MakeFinger

    text = text_of("x (mm),z (um)", X_M * 1e3, RIDGES_M[0] * 1e6)
    result = MakeFinger(text=text).run(Context(tmp_path))
    assert result.document["h_rms_m"] == pytest.approx(RMS_M * FRACTION, rel=0.01)
    assert haptix.Finger.load(tmp_path / "finger.toml").roughness.source == "text"
    fields = MakeFinger.body().model_fields
    assert {"text", "convention", "remove"} <= fields.keys()
    assert not {"measurements", "dielectric", "out"} & fields.keys()


@pytest.mark.parametrize("suffix", [".txt", ".npy"])
def test_a_void_of_a_map_is_no_height(tmp_path: Path, suffix: str) -> None:
    heights = RIDGES_M * 1e6
    heights[3:6, 40:44] = -9999
    path = tmp_path / f"map{suffix}"
    np.save(path, heights) if suffix == ".npy" else path.write_text(text_of("", *heights.T))
    surface = read_surface(path, "um", PIXEL_M)
    assert np.isnan(surface.heights_m[0]).sum() == 12
    # The holes are filled from their neighbours.
    assert float(RoughnessSpectrum.of_surface(surface).h_rms_m) == pytest.approx(RMS_M, rel=0.02)


def test_heights_before_positions_are_the_same_scan() -> None:
    in_um = X_M * 1e6, RIDGES_M[0] * 1e6
    scan, same = (
        read_surface(MeasuredTable.of(text, "text"))
        for text in (text_of("x (um),z (um)", *in_um), text_of("z (um),x (um)", *in_um[::-1]))
    )
    assert same.heights_m[0] == pytest.approx(scan.heights_m[0])
    assert same.pixel_m == pytest.approx(scan.pixel_m)


def test_a_spectrum_of_text_and_a_scan_without_units() -> None:
    columns = MeasuredTable.of(text_of("", X_M * 1e6, RIDGES_M[0] * 1e6), "text")
    surface = read_surface(columns, unit="um")
    spectrum = RoughnessSpectrum.of_surface(surface)
    assert float(spectrum.h_rms_m) == pytest.approx(RMS_M * FRACTION, rel=0.01)
    with pytest.raises(InputError, match="--unit"):
        read_spectrum(columns, "C")
