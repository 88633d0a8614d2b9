"""``haptix material``, and materials on the command line."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import haptix
from haptix.feel.materials import KINDS

HERE = Path(haptix.__file__).parents[1]
EXAMPLES = HERE / "examples" / "materials"
OWN = sorted(kind for kind, of in KINDS.items() if of.__module__.startswith("haptix."))


@pytest.mark.parametrize("kind", ["dial", "relief"])
def test_show_draws_a_material(haptix_cli, kind, own_folder):
    shutil.copytree(EXAMPLES, own_folder, dirs_exist_ok=True)
    (row,) = json.loads(haptix_cli("material", "show", f"{kind}.toml", "--json").out)
    assert row["kind"] == kind
    assert row["depends_on"] == {"dial": "place", "relief": "place, direction"}[kind]
    with Image.open(row["picture"]) as picture:
        assert len(picture.convert("RGB").getcolors(1 << 20)) > 20


def test_kinds_lists_every_kind_with_its_fields(haptix_cli):
    rows = {row["kind"]: row for row in json.loads(haptix_cli("material", "kinds", "--json").out)}
    assert set(OWN) <= set(rows)
    assert rows["grating"]["fields"]["period_mm"] == "required"
    assert rows["grating"]["fields"]["wave"] == "sine"
    assert json.loads(haptix_cli("material", "schema").out)["$defs"]["material"]["oneOf"]


@pytest.mark.parametrize("kind", OWN)
def test_every_kind_has_an_example_a_picture_and_a_paragraph(kind):
    assert haptix.feel.materials.load(EXAMPLES / f"{kind}.toml").kind == kind
    page = (HERE / "docs" / "materials.md").read_text()
    assert f"### {kind}\n" in page
    assert f"materials/{kind}.png" in page
    assert (HERE / "docs" / "materials" / f"{kind}.png").exists()


@pytest.mark.slow
def test_a_material_is_rendered_and_what_is_wrong_is_one_sentence(
    haptix_cli, own_folder, surface_file
):
    Path("path.csv").write_text("t_s,x_mm,y_mm,normal_force_n\n0,1,5,0.5\n0.3,25,5,0.5\n")
    Path("wrong.toml").write_text('kind = "slider"\ndetents = 1\n')
    shutil.copy(EXAMPLES / "slider.toml", own_folder)
    with_path = ("--trajectory", "path.csv", "--surface", str(surface_file))
    (summary,) = json.loads(
        haptix_cli("render", "--material", "slider.toml", *with_path, "--json").out
    )
    assert summary["photograph"] == "slider.toml"
    low, high = summary["target_mu"]
    assert high > 1.1 * low  # it met ridges
    for arguments, message in (
        (("wrong.toml",), "wrong.toml: slider.detents"),
        (("slider.toml", "--width-mm", "9"), "--material: expected no --image"),
    ):
        result = haptix_cli("render", "--material", *arguments, *with_path)
        assert result.code == 2
        assert message in result.err
        assert result.err.count("\n") == 1


def made_up_recording(path, speed=60.0):
    """Ridges of 1.6 mm and a slower wave, along 24 mm at 2 kHz."""
    t = np.arange(0, 24 / speed, 5e-4)
    x = speed * t
    mu = 0.5 * (1 + 0.06 * np.sin(2 * np.pi * x / 1.6) + 0.03 * np.sin(2 * np.pi * x / 0.31))
    lines = [f"{a:.6f},{b:.5f},{c:.6f}" for a, b, c in zip(t, x, mu, strict=True)]
    path.write_text("t_s,position_mm,mu\n" + "\n".join(lines))


@pytest.mark.slow
def test_fit_writes_a_small_material_and_says_in_which_bands_it_is_near(haptix_cli, own_folder):
    made_up_recording(own_folder / "ridges.csv")
    rows = json.loads(haptix_cli("material", "fit", "ridges.csv", "--json").out)
    assert (own_folder / "ridges.toml").stat().st_size <= 300
    material = haptix.feel.materials.load(own_folder / "ridges.toml")
    assert isinstance(material, haptix.feel.materials.Spectral)
    assert [round(period, 1) for period, _ in material.waves] == [1.6, 0.3]
    near = {row["band"]: row["within"] for row in rows}
    # 1.6 mm are 62.5 Hz at 100 mm/s; 0.31 mm are 64.5, 145 and 323 Hz at 20, 45 and 100. Where
    # neither is, there are skirts of a window alone.
    for band, least in (("46-77 Hz", 4), ("129-215 Hz", 1), ("215-359 Hz", 2)):
        assert int(near[band][0]) >= least


def test_a_recording_is_nearer_to_itself_at_another_speed_than_to_another(haptix_cli, own_folder):
    for name, speed in (("slow", 40.0), ("fast", 60.0)):
        made_up_recording(own_folder / f"{name}.csv", speed)
    (row,) = json.loads(haptix_cli("material", "distance", "slow.csv", "fast.csv", "--json").out)
    other = str(EXAMPLES / "spectral.toml")
    (far,) = json.loads(haptix_cli("material", "distance", "slow.csv", other, "--json").out)
    assert row["distance_db"] < 0.5 * far["distance_db"]
    share = str(EXAMPLES / "grating.toml")
    result = haptix_cli("material", "distance", "slow.csv", share)
    assert result.code == 2
    assert "share" in result.err
