"""The files that are written, how they look, and what is refused."""

import csv
import json

import numpy as np
import pytest
import typer
from skimage.io import imread
from typer.testing import CliRunner

import haptix
import haptix.figures.folder as folder_module
from haptix import InputError
from haptix.cli.figures import figures as command
from haptix.figures import FIGURES, draw, write_figures

NAMES = ("fig2d", "fig3b", "fig3c", "fig3d", "fig4", "roughness", "gaps")
BOTH = "roughness spectrum of the finger and dielectric of the skin."
ROUGHNESS = "Placeholders, not measured: roughness spectrum of the finger."


@pytest.fixture
def quick(figures, monkeypatch):
    """Only the lightest figure, ready made."""
    monkeypatch.setattr(folder_module, "FIGURES", {"gaps": lambda: figures["gaps"]})


def contents(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.slow
def test_every_figure_has_its_files(drawn):
    folder, written = drawn
    assert tuple(FIGURES) == NAMES
    expected = {f"{name}{end}" for name in NAMES for end in (".png", ".csv")} | {"captions.json"}
    assert {path.name for path in folder.iterdir()} == expected
    assert tuple(data.name for data in written) == NAMES
    for name in NAMES:
        image = imread(folder / f"{name}.png")
        # At 200 dots per inch: 6 by 4 inches and more, and something is drawn.
        assert image.shape[1] > 1200 and image.shape[0] > 800
        assert (image[..., :3].min(axis=-1) < 200).mean() > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_table_holds_the_columns(drawn, figures, name):
    with (drawn[0] / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert head == list(figures[name].columns)
    for column, cells in zip(head, zip(*rows, strict=True), strict=True):
        numbers = np.array([float(cell) if cell else np.nan for cell in cells])
        # Ten digits are written.
        np.testing.assert_allclose(numbers, figures[name].columns[column], rtol=1e-9)


@pytest.mark.slow
def test_the_captions_lie_beside_the_tables(drawn, figures):
    captions = json.loads((drawn[0] / "captions.json").read_text(encoding="utf-8"))
    assert captions["haptix"] == haptix.__version__
    assert tuple(captions["figures"]) == NAMES
    for name, entry in captions["figures"].items():
        assert entry["caption"] == figures[name].caption
        assert (drawn[0] / entry["png"]).is_file() and (drawn[0] / entry["csv"]).is_file()
        assert entry["columns"] == list(figures[name].columns)


@pytest.mark.parametrize(
    ("name", "placeholders", "terms"),
    [
        ("fig3b", ROUGHNESS, {"layered-skin", "apparent-area", "breakdown"}),
        ("fig3c", ROUGHNESS, {"layered-skin", "apparent-area", "breakdown"}),
        ("fig3d", ROUGHNESS, {"layered-skin", "breakdown"}),
        ("fig4", BOTH, {"leaky-gap", "skin-dielectric", "layered-skin"}),
        ("gaps", ROUGHNESS, {"layered-skin"}),
    ],
)
def test_captions_say_what_the_numbers_rest_on(figures, name, placeholders, terms):
    caption = figures[name].caption
    assert placeholders in caption
    on = caption.split("Terms on: ")[1]
    assert all(term in on for term in terms)
    assert "ontact spots" in caption and "excluded" in caption
    assert "nan" not in caption


def test_the_caption_of_the_roughness_calls_its_spectra_placeholders(figures):
    assert "Placeholders, not measured: all three spectra" in figures["roughness"].caption


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_nothing_hides_a_curve_or_is_cut_off(figures, name):
    figure = draw(figures[name])
    figure.draw_without_rendering()
    page = figure.bbox
    axes_boxes = [axes.get_window_extent() for axes in figure.axes]
    legends = [axes.get_legend().get_window_extent() for axes in figure.axes if axes.get_legend()]
    assert legends
    (caption,) = figure.texts
    assert caption.get_text().replace("\N{NO-BREAK SPACE}", " ").split() == (
        figures[name].caption.split()
    )
    below = caption.get_window_extent()
    tight = [axes.get_tightbbox() for axes in figure.axes]
    for box in (*legends, *tight, below):
        # Within a pixel of the page: boxes are rounded outwards.
        assert box.x0 >= page.x0 - 1 and box.x1 <= page.x1 + 1
        assert box.y0 >= page.y0 - 1 and box.y1 <= page.y1 + 1
    for axes_box in axes_boxes:
        assert not any(legend.overlaps(axes_box) for legend in legends)
    assert not any(box.overlaps(below) for box in tight)


@pytest.mark.parametrize("name", NAMES)
def test_axes_have_units_and_every_curve_lies_on_them(figures, name):
    without_unit = ("mu", "A_", "slope")  # mu, A/A0 and a slope are pure numbers
    for axes in draw(figures[name]).axes:
        for label in filter(None, (axes.get_xlabel(), axes.get_ylabel())):
            assert label.endswith(")") or any(word in label for word in without_unit)
        curves = [line.get_xydata().T for line in axes.lines if len(line.get_xdata()) > 1]
        assert curves
        for x, y in curves:
            (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
            inside = (x >= left) & (x <= right) & (y >= low) & (y <= high)
            assert inside.sum() > 0.5 * (~np.isnan(y)).sum()


@pytest.mark.parametrize("name", NAMES)
def test_what_is_drawn_is_in_the_table(figures, name):
    columns = list(figures[name].columns.values())
    for line in (line for axes in draw(figures[name]).axes for line in axes.lines):
        x, y = line.get_xydata().T
        if len(x) > 1:
            assert line.get_marker() in ("_", "|") or all(
                any(np.array_equal(drawn, column, equal_nan=True) for column in columns)
                for drawn in (x, y)
            )
        elif len(x) == 1:  # a mark lies on a curve
            assert any(x[0] in column for column in columns)
            assert any(y[0] in column for column in columns)


@pytest.mark.usefixtures("quick")
def test_existing_files_are_replaced_and_others_stay(tmp_path):
    (tmp_path / "gaps.csv").write_text("old")
    (tmp_path / "notes.txt").write_text("mine")
    write_figures(tmp_path)
    assert (tmp_path / "gaps.csv").read_text().startswith("gap_um,")
    assert (tmp_path / "notes.txt").read_text() == "mine"
    first = contents(tmp_path)
    write_figures(tmp_path)
    assert contents(tmp_path) == first
    assert set(map(str, first)) == {"gaps.csv", "gaps.png", "captions.json", "notes.txt"}


@pytest.mark.parametrize("out", ["file", "file/deep/er", "taken"])
def test_a_refused_out_writes_and_computes_nothing(tmp_path, monkeypatch, out):
    def never():
        raise AssertionError("computed before the folder was checked")

    monkeypatch.setattr(folder_module, "FIGURES", {"fig4": never})
    (tmp_path / "file").write_text("x")
    (tmp_path / "taken" / "fig4.png").mkdir(parents=True)
    (tmp_path / "taken" / "fig4.csv").write_text("old")
    before = contents(tmp_path)
    with pytest.raises(InputError, match=r"^--out: .* is a (file|folder)"):
        write_figures(tmp_path / out)
    assert contents(tmp_path) == before


def test_a_figure_that_fails_writes_nothing(tmp_path, monkeypatch, figures):
    def fails():
        raise InputError("no")

    made = {"gaps": lambda: figures["gaps"], "fig4": fails}
    monkeypatch.setattr(folder_module, "FIGURES", made)
    with pytest.raises(InputError):
        write_figures(tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("quick")
@pytest.mark.slow
def test_the_command_lists_what_it_wrote(tmp_path):
    app = typer.Typer()
    app.command()(command)
    result = CliRunner().invoke(app, ["--out", str(tmp_path / "out"), "--json"])
    assert result.exit_code == 0, result.output
    (row,) = json.loads(result.stdout)
    assert row["figure"] == "gaps"
    assert row["png"] == str(tmp_path / "out" / "gaps.png")
    assert "Placeholders" in row["caption"]
    plain = CliRunner().invoke(app, ["--out", str(tmp_path / "out")])
    assert plain.exit_code == 0
    assert "gaps" in plain.stdout
