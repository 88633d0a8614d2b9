"""``haptix tradeoff``: what it tries, what it finds, what it leaves behind."""

import csv
import json
from itertools import product

import pytest
import torch
from matplotlib.image import imread

from haptix.plan.tradeoff import default_scene


def chosen(rows, **wanted):
    return [row for row in rows if all(row[name] == value for name, value in wanted.items())]


@pytest.mark.slow
def test_every_combination_is_tried(folder):
    devices = ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",)
    tried = {
        (row["model"], row["tolerance"], row["dtype"], row["form"], row["device"])
        for row in folder.rows
        if row["model"] != "planned"
    }
    assert tried == set(
        product(
            ("mean-field", "closed-form"),
            ("0.05 JND", "0.5 JND"),
            ("float64", "float32"),
            ("surface", "slice"),
            devices,
        )
    )
    assert {row["form"] for row in chosen(folder.rows, model="planned")} == {"surface", "slice"}


@pytest.mark.slow
def test_errors_are_those_of_surface_and_fidelity(folder, scene):
    for row in folder.rows:
        assert 0 < row["error_p99_jnd"] <= row["error_max_jnd"]
        # A threshold is 0.11 mu.
        assert row["error_max_mu"] > 0
    for row in chosen(folder.rows, model="planned"):
        assert row["error_max_jnd"] <= scene.budget_jnd
    for row in chosen(folder.rows, model="mean-field"):
        # The build checks points of its own; these are others, among them the corners, where a
        # surface is worst: twice the tolerance would be a surface that did not check at all.
        assert row["error_max_jnd"] < 2 * float(row["tolerance"].split()[0])
    # The light-contact formula has an error of its own, which no tolerance removes.
    fine = {
        model: chosen(
            folder.rows, model=model, tolerance="0.05 JND", dtype="float64", form="surface"
        )[0]["error_max_jnd"]
        for model in ("mean-field", "closed-form")
    }
    assert fine["mean-field"] < fine["closed-form"]


@pytest.mark.slow
def test_float32_halves_the_memory_and_a_slice_has_less(folder):
    def size(dtype, form):
        (row,) = chosen(
            folder.rows,
            model="mean-field",
            tolerance="0.05 JND",
            dtype=dtype,
            form=form,
            device="cpu",
        )
        return row["memory_bytes"]

    assert 2 * size("float32", "surface") == size("float64", "surface")
    assert size("float64", "slice") < size("float64", "surface")


@pytest.mark.slow
@pytest.mark.parametrize("form", ["surface", "slice"])
def test_the_fronts_have_what_nothing_beats(folder, form):
    columns = {"build": "build_s", "query": "query_s_per_million", "memory": "memory_bytes"}
    rows = chosen(folder.rows, form=form)
    for name, column in columns.items():
        best = min(row["error_max_jnd"] for row in rows)
        front = [row for row in rows if name in row["fronts"].split()]
        least = min(row["error_max_jnd"] for row in front)
        # Errors are compared to three digits, so that rounding wins nothing.
        assert least == pytest.approx(best, rel=0.01)
        assert min(row[column] for row in front) == min(row[column] for row in rows)


@pytest.mark.slow
def test_what_to_take_is_a_whole_surface_within_what_it_is_for(folder, scene):
    taken = {purpose: row for row in folder.rows for purpose in row["take"].split(", ")}
    del taken[""]
    budget = scene.budget_jnd
    whole = chosen(folder.rows, form="surface")
    assert all(row["form"] == "surface" for row in taken.values())
    assert taken["as planned"]["model"] == "planned"
    for purpose, limit in (
        ("smallest within the budget", budget),
        ("smallest within a tenth of the budget", budget / 10),
    ):
        within = [row for row in whole if row["error_max_jnd"] <= limit]
        assert (purpose in taken) is bool(within)
        for row in within:
            assert taken[purpose]["memory_bytes"] <= row["memory_bytes"]
    exact = taken["most exact"]["error_max_jnd"]
    assert exact == pytest.approx(min(row["error_max_jnd"] for row in whole), rel=0.01)


@pytest.mark.slow
def test_the_files_agree(folder, scene):
    record = json.loads((folder.path / "tradeoff.json").read_text())
    assert record["runs"] == folder.rows
    assert record["scene"] == scene.name
    assert record["budget_jnd"] == scene.budget_jnd
    assert record["machine"]["torch"] == torch.__version__
    with (folder.path / "tradeoff.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(folder.rows)
    for read, row in zip(rows, folder.rows, strict=True):
        assert list(read) == list(row)
        # Six digits are written.
        assert float(read["build_s"]) == pytest.approx(row["build_s"], rel=1e-5)
        assert read["fronts"] == row["fronts"]
    assert sorted(path.name for path in folder.path.iterdir()) == [
        "tradeoff.csv",
        "tradeoff.json",
        "tradeoff.png",
    ]


@pytest.mark.slow
def test_the_plot_is_a_picture_with_ink(folder):
    pixels = imread(folder.path / "tradeoff.png")
    assert pixels.shape[0] > 500
    assert pixels.shape[1] > 1500
    assert len({tuple(pixel) for pixel in pixels.reshape(-1, pixels.shape[2])[::7]}) > 20


def test_without_a_scene_everything_varies():
    assert all(low < high for low, high in default_scene().ranges().values())


def test_a_wrong_folder_is_refused_before_the_work(haptix_cli, tmp_path):
    (tmp_path / "file").write_text("x")
    done = haptix_cli("tradeoff", "--quick", "--out", tmp_path / "file")
    assert done.code == 2
    assert "is a file; name a folder" in done.err
    (tmp_path / "out" / "tradeoff.png").mkdir(parents=True)
    done = haptix_cli("tradeoff", "--quick", "--out", tmp_path / "out")
    assert done.code == 2
    assert "is a folder; name another --out" in done.err
    assert len(done.err.splitlines()) == 1


def test_a_wrong_scene_is_one_sentence(haptix_cli, tmp_path):
    done = haptix_cli("tradeoff", tmp_path / "none.toml", "--out", tmp_path / "out")
    assert done.code == 2
    assert len(done.err.splitlines()) == 1
    assert not (tmp_path / "out").exists()
