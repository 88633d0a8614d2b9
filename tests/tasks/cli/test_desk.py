"""A new task is one class in one file: command, route, form, job and campaign come from it."""

import json
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest
from fastapi import FastAPI

import calibration
import haptix.tasks
from haptix.base import task as desk
from haptix.base import task_list
from haptix.base.task import Task
from haptix.service.front.rest import jobs_router
from haptix.service.worker.process import JobWork
from haptix.tasks import cli
from haptix.tasks.campaign.plans import load_campaign
from haptix.tasks.campaign.run import run_campaign
from haptix.tasks.strokes import Render
from tests.command_line import run_haptix
from tests.one_task import put_in


@pytest.fixture
def charge(own_folder, monkeypatch):
    """The file in place, and nothing else: its commands are listed as those of haptix are."""
    put_in(own_folder, monkeypatch)
    yield own_folder
    sys.modules.pop("charging", None)


def test_its_command_has_help_units_and_defaults(charge):
    assert re.search("charge +Charge of a capacitor at some voltages.", cli.help_text())
    shown = " ".join(run_haptix("charge", "--help").out.split())
    assert "--voltage-v V,... Amplitudes. [required]" in shown
    assert "--width-mm mm Width of a square electrode. [default: 10]" in shown


def test_the_table_has_every_task_with_its_command_and_sentence():
    folders = Path(haptix.tasks.__file__).parent, Path(calibration.__file__).parent
    names = [f"{p.parent.name}.{p.stem}" for folder in folders for p in folder.glob("*.py")]
    modules = [f"haptix.{name}" if name.startswith("tasks.") else name for name in names]
    values = [v for m in modules if "__" not in m for v in vars(import_module(m)).values()]
    tasks = {v for v in values if isinstance(v, type) and issubclass(v, Task)}
    tasks = {task for task in tasks if task.command or task.route}
    with_command = {
        task.command: (f"{task.__module__}:{task.__name__}", task.__doc__.split("\n")[0])
        for task in tasks if task.command
    }  # fmt: skip
    assert with_command == task_list.TASKS
    others = {f"{task.__module__}:{task.__name__}" for task in tasks if not task.command}
    assert others == set(task_list.WITHOUT_COMMAND)


def test_its_command_understands_units_and_says_so(charge):
    shown = run_haptix("charge", "--voltage-v", "1.5 V,200mV", "--width-mm", "6cm", "--json")
    assert shown.code == 0, shown.err
    assert [row["voltage_v"] for row in json.loads(shown.out)["rows"]] == [1.5, 0.2]
    assert json.loads(shown.out)["last_c"] == pytest.approx(1e-6 * 0.06**2 * 0.2)
    assert "--voltage-v: 1.5 and 0.2 V" in shown.err and "--width-mm: 60 mm" in shown.err


@pytest.mark.parametrize(
    ("width", "words"),
    [("0,4", "point: 0.4"), ("0", "above 0"), ("4 V", "such as"), ("nan", "finite")],
)
def test_its_command_refuses_what_is_no_width(charge, width, words):
    shown = run_haptix("charge", "--voltage-v", "1", "--width-mm", width)
    assert (shown.code, shown.out) == (2, "")
    assert shown.err.startswith("haptix: --width-mm: ") and words in shown.err


@pytest.mark.parametrize(
    ("voltages", "meant"), [("-2,5", "; the decimal sign is a point: -2.5"), ("-2,5,1", "")]
)
def test_a_refused_list_says_how_a_decimal_point_is_written(charge, voltages, meant):
    shown = run_haptix("charge", f"--voltage-v={voltages}")
    wrong = f"haptix: --voltage-v: expected a finite number of at least 0, got -2{meant}\n"
    assert (shown.code, shown.out, shown.err) == (2, "", wrong)


class Board:
    """Knows no device."""

    def __init__(self):
        self.context = {}


def test_its_route_has_a_schema_for_a_form_and_names_no_files(charge):
    app = FastAPI()
    app.include_router(jobs_router(Board()))
    assert "post" in app.openapi()["paths"]["/v1/charges"]
    fields = app.openapi()["components"]["schemas"]["ChargeRequest"]["properties"]
    assert set(fields) == {"voltage_v", "width_mm"}
    width = fields["width_mm"]
    assert (width["x-unit"], width["default"], width["exclusiveMinimum"]) == ("mm", 10.0, 0)
    assert width["description"] == "Width of a square electrode."


def test_what_only_clients_give_has_its_title_and_unit_too():
    fields = Render.body().model_json_schema()["properties"]
    found = {name: (fields[name]["title"], fields[name]["x-unit"]) for name in ("t_s", "x_mm")}
    assert found == {"t_s": ("T", "s"), "x_mm": ("X", "mm")}
    assert fields["normal_force_n"]["examples"] == [[0.5, 0.5]]


def test_its_job_runs(charge):
    said = []
    context = {"assets": str(charge), "results": str(charge / "results")}
    work = JobWork(context, lambda **fields: said.append(fields), iter(()))
    assert work.charge(voltage_v=[2.0])["last_c"] == pytest.approx(2e-10)
    assert (charge / "results" / "charges.csv").read_text().endswith("\n2,2e-10\n")


def test_its_campaign_runs_each_combination(charge):
    (charge / "plan.toml").write_text(
        'name = "charges"\nkind = "charging:Charge"\n[task]\nvoltage_v = ["1 V"]\n'
        '[vary]\nwidth_mm = ["1 cm", "2 cm"]\n'
    )
    result = run_campaign(load_campaign(charge / "plan.toml"), charge / "out")
    assert result.counts["done"] == 2
    found = sorted(row["last_c"] for row in result.rows)
    assert found == pytest.approx([1e-10, 4e-10])


def test_a_cancelled_task_ends_where_it_says_how_far_it_is():
    context = desk.Context()
    context.progress("solve", 0.25)
    context.cancel()
    with pytest.raises(haptix.HaptixError, match="cancelled"):
        context.progress("solve", 0.5)
