"""The kinds of campaigns: what they expand to, and that each task is a pure function."""

import json
import re
import warnings
from math import log

import pytest
from typer.testing import CliRunner

from haptix.base.errors import InputError
from haptix.base.task import task_at
from haptix.lab.population import Population
from haptix.lab.stimuli.recipe import Recipe
from haptix.model.fidelity import BoundaryElementBox
from haptix.model.finger import Finger
from haptix.model.friction import ContactModel
from haptix.model.screen import Screen
from haptix.model.surface import FrictionSurface
from haptix.plan.planning import plan_scene
from haptix.plan.tradeoff import run_tradeoff
from haptix.tasks.campaign import CampaignTask, load_campaign, run_campaign
from haptix.tasks.cli.application import app


@pytest.fixture(autouse=True)
def page(monkeypatch):
    """Reports are tested elsewhere."""
    monkeypatch.setattr("haptix.tasks.campaign.run.report_html", lambda campaign, tasks: "page")


@pytest.fixture
def load(tmp_path):
    """Load the campaign of a text; "gel.toml" beside it is a half-space, which is cheap."""

    def load(text):
        (tmp_path / "gel.toml").write_text('name = "gel"\n')
        (tmp_path / "plan.toml").write_text(text)
        return load_campaign(tmp_path / "plan.toml")

    return load


SCENE = """
[scene]
normal_force_n = ["0.2 N", 1.0]
drive = { scheme = "direct", frequency_hz = 125 }
budget_jnd = 2
"""


def test_people_times_screens_have_their_names_and_keys(load):
    plan = load(
        'name = "a"\nkind = "surfaces"\nfingers = ["gel.toml", "wet"]\n'
        'insulator_thickness_m = ["1 um", "2 um", "3 um"]\n'
        "[population]\nsize = 4\nseed = 3\nspread = { youngs_modulus_pa = 0.3 }\n" + SCENE
    )
    tasks = [*plan.tasks()]
    assert len({task.key for task in tasks}) == 2 * 4 * 3
    assert [task.key for task in plan.tasks()] == [task.key for task in tasks]
    first = tasks[0]
    assert first.task.scene.normal_force_n == (0.2, 1.0)
    # The value itself, as the name has it: of a log-normal of 0.3 within six deviations of 40 MPa.
    modulus = first.task.scene.finger.youngs_modulus_pa
    assert first.labels["youngs_modulus_pa"] == modulus
    assert abs(log(modulus / 40e6)) < 6 * 0.3
    assert {task.labels["insulator_thickness_m"] for task in tasks} == {1e-6, 2e-6, 3e-6}
    # The name of the campaign is no part of a result.
    other = plan.replace(name="b")
    assert [task.key for task in other.tasks()] == [task.key for task in tasks]
    # A longer one has the same people at its beginning.
    more = plan.replace(population={**plan.population.model_dump(), "size": 5})
    assert {task.key for task in tasks} < {task.key for task in more.tasks()}


@pytest.mark.slow
def test_a_surface_is_that_of_its_scene(load, tmp_path):
    plan = load('name = "a"\nkind = "surfaces"\nfingers = ["gel.toml"]\n' + SCENE)
    done = run_campaign(plan, tmp_path / "out")
    [row], [task] = done.rows, plan.tasks()
    file = tmp_path / "out" / "results" / row["key"][:2] / row["key"] / "friction.surface"
    surface = plan_scene(task.task.scene).build()
    surface.save(tmp_path / "same.surface")
    assert file.read_bytes() == (tmp_path / "same.surface").read_bytes()
    assert FrictionSurface.load(file).info["mu_low"] == row["mu_low"] > 0


STATES = 'normal_force_n = [0.2, 1.0]\nvoltage_v = [0, "100 V"]\nfrequency_hz = [125]\n'


def test_a_population_has_the_friction_of_its_models(load, tmp_path):
    plan = load(
        'name = "a"\nkind = "population"\nfingers = ["gel.toml"]\n' + STATES
        + "[population]\nsize = 2\nseed = 3\nspread = { frictional_shear_stress_pa = 0.3 }\n"
    )  # fmt: skip
    done = run_campaign(plan, tmp_path / "out")
    people = Population.around(
        Finger.load(tmp_path / "gel.toml"), 2, {"frictional_shear_stress_pa": 0.3}, 3
    )
    table = people.run(Screen.preset("3m-sct3250"), [0.2, 1.0], [0, 100], [125])
    for row, finger, found in zip(done.rows, people.fingers, table, strict=True):
        model = ContactModel(finger, Screen.preset("3m-sct3250"))
        # One state at a time against all in one batch: the tables are the same.
        first = float(model.solve(0.2, 0.0, 125.0).mu)
        last = float(model.solve(1.0, 100.0, 125.0).mu)
        assert (row["mu_first"], row["mu_last"]) == pytest.approx((first, last), rel=1e-9)
        assert found["mu"] == pytest.approx([first, found["mu"][1], found["mu"][2], last])
        file = tmp_path / "out" / "results" / row["key"][:2] / row["key"] / "states.csv"
        rows = [line.split(",") for line in file.read_text().splitlines()]
        assert [float(cell) for cell in rows[4][:4]] == [1.0, 100.0, 125.0, row["mu_last"]]
    assert done.rows[0]["mu_first"] != done.rows[1]["mu_first"]


def test_a_surface_of_boundary_elements_is_a_task(load, tmp_path):
    plan = load(
        'name = "a"\nkind = "boundary-elements"\nfingers = ["gel.toml"]\nsurfaces = 2\nseed = 5\n'
        "normal_force_n = [0.5]\nvoltage_v = [0]\nfrequency_hz = [125]\nbox = { points = 32 }\n"
    )
    done = run_campaign(plan, tmp_path / "out")
    assert [row["surface"] for row in done.rows] == [5, 6]
    areas = [row["area_first"] for row in done.rows]
    # Another seed is another surface, and each is that of a model with its seed.
    assert areas[0] != areas[1]
    box = BoundaryElementBox(points=32, surfaces=1, seed=6)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = ContactModel(
            Finger.load(tmp_path / "gel.toml"), Screen(name="3m-sct3250"), "boundary-element",
            boundary_elements=box,
        )  # fmt: skip
        assert float(model.solve(0.5, 0.0, 125.0).area_fraction) == areas[1]


EXPERIMENT = """
name = "threshold"
seed = 5
stimulus = { signal = { kind = "sine", amplitude = 1.0, frequency_hz = 125 }, length_s = 0.1 }
method = { kind = "up-down", start = 30.0, steps = [4.0, 2.0], stop_after = 6 }
"""


@pytest.mark.slow  # simulations are tested by themselves
def test_simulations_are_those_of_the_command(load, tmp_path, monkeypatch):
    short = {"_KNOWN_WITHIN": 1, "_LEAST_ROUNDS": 2, "_TESTED": 40, "_QUICK": 100, "_FITTED": 6}
    for name, value in short.items():
        monkeypatch.setattr(f"haptix.lab.analysis.power.{name}", value)
    (tmp_path / "experiment.toml").write_text(EXPERIMENT)
    plan = load(
        'name = "a"\nkind = "experiment-simulations"\nexperiments = ["exp*.toml"]\nruns = 12\n'
        "threshold_db = [24]\nlapse = [0.02]\ncomparison = { participants = [6, 20] }\n"
    )
    rows = run_campaign(plan, tmp_path / "out").rows
    assert [row["what"] for row in rows] == ["accuracy"] * 2 + ["power"] * 4
    asked = ["--threshold-db", "24", "--lapse", "0.02", "--runs", "12", "--json"]
    command = ["stimuli", "simulate", str(tmp_path / "experiment.toml"), *asked]
    told = json.loads(CliRunner().invoke(app, command).stdout)
    # Each simulation has its own seed in its document: by itself or beside others, the same.
    assert [{name: row[name] for name in told[0]} for row in rows[:2]] == told
    steep = [row["power"] for row in rows if row["what"] == "power" and row["slope"] == 3.5]
    assert 0 <= steep[0] < steep[1] <= 1  # more people find more
    compared = ["--participants", "6", "--threshold-db", "24", "--runs", "10"]
    said = CliRunner().invoke(app, [*command[:3], *compared])
    assert re.search(r"expected: \d+ to \d+ minutes", said.stderr), said.stderr
    assert "6 participants: 0." in said.stdout


SET = """
name = "tones"
finger = "gel.toml"
[stimuli.tone]
quantity = "volts"
signal = { kind = "sine", amplitude = 60.0, frequency_hz = 125 }
drive_hz = 125
length_s = 0.05
"""


def test_a_set_is_that_of_its_recipe(load, tmp_path, monkeypatch):
    monkeypatch.setenv("HAPTIX_CACHE", str(tmp_path / "cache"))
    (tmp_path / "tones.toml").write_text(SET)
    (tmp_path / "soft.toml").write_text('name = "soft"\nyoungs_modulus_pa = 2e7\n')
    plan = load(
        'name = "a"\nkind = "stimulus-sets"\nrecipes = ["tones.toml"]\n'
        'fingers = ["gel.toml", "soft.toml"]\n'
    )
    done = run_campaign(plan, tmp_path / "out")
    assert [(row["finger"], row["status"]) for row in done.rows] == [
        ("gel", "done"), ("soft", "done"),
    ]  # fmt: skip
    Recipe.load(tmp_path / "tones.toml").stimulus_set().make(tmp_path / "set")
    for path in (tmp_path / "set").iterdir():
        key = done.rows[0]["key"]
        assert (tmp_path / "out" / "results" / key[:2] / key / path.name).read_bytes() == (
            path.read_bytes()
        ), path.name


def test_nothing_of_a_name_is_one_sentence(load):
    plan = load('name = "a"\nkind = "stimulus-sets"\nrecipes = ["sets/*.toml"]\n')
    with pytest.raises(InputError, match=r"sets/\*\.toml"):
        [*plan.tasks()]


def test_a_document_survives_its_way_to_a_worker(load):
    for kind, rest in (
        ("surfaces", SCENE),
        ("trade-off", SCENE),
        ("population", STATES),
        ("boundary-elements", STATES),
    ):
        plan = load(f'name = "a"\nkind = "{kind}"\n' + rest)
        task = next(plan.tasks())
        document = json.loads(json.dumps(task.document))
        there = CampaignTask(task_at(task.task.path())(**document))
        assert (there.document, there.key) == (task.document, task.key)
        assert there.task.needed_bytes > 0


@pytest.mark.slow
def test_the_trade_off_is_that_of_the_command(load, tmp_path, monkeypatch):
    monkeypatch.setattr("haptix.plan.tradeoff.TABULATED", ("closed-form",))
    monkeypatch.setattr("haptix.plan.tradeoff.QUICK", (100, 1000, (0.5,)))
    plan = load('name = "a"\nkind = "trade-off"\nquick = true\nfingers = ["gel.toml"]\n' + SCENE)
    scene = next(plan.tasks()).task.scene
    done = run_campaign(plan, tmp_path / "out")
    assert done.counts["done"] == 2
    measured = run_tradeoff(scene, True).runs
    files = [path.read_text() for path in (tmp_path / "out").glob("results/*/*/runs.json")]
    runs = [run for text in files for run in json.loads(text)["runs"]]
    assert not any("build_s" in run for run in runs)  # two runs would differ
    assert {run["error_max_jnd"] for run in runs} == {run.error_max_jnd for run in measured}
    assert all(row["build_s"] > 0 for row in done.rows)
