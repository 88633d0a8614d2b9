"""Forms of tasks: what is declared at the desk is asked for on the page."""

import sys

import pytest
from pydantic import Field
from pydantic.fields import FieldInfo

from calibration.tasks import CalibrationJob
from haptix.tasks.stimuli import ExperimentJob
from tests.one_task import put_in
from tests.studio.conftest import a_front, a_page, address, keep, violations
from tests.waiting import wait_for

PAUSE = Field(1.5, ge=0, le=9, description="Rest between two strokes.")
MORE = {
    "pause_s": FieldInfo.from_annotated_attribute(float, PAUSE),
    "tries": FieldInfo.from_annotated_attribute(int, Field(2, ge=1, title="Attempts")),
    "is_loud": FieldInfo.from_annotated_attribute(bool, False),
    "voltages_v": FieldInfo.from_annotated_attribute(tuple[float, ...], (50.0, 100.0)),
}


@pytest.fixture
def begun(tmp_path, monkeypatch, browser):
    """A page before a front whose tasks have more parameters, and what it begins."""
    for task in (CalibrationJob, ExperimentJob):
        for name, parameter in MORE.items():
            monkeypatch.setitem(task.model_fields, name, parameter)
    with a_front(tmp_path) as front, a_page(browser) as page:
        told = []
        begin = front.hub.jobs.begin

        def hear(kind, owner, **fields):
            told.append((kind, fields))
            message = begin(kind, owner, **fields)
            front.hub.jobs.cancel(front.hub.jobs.get(message.job, owner))
            return message

        monkeypatch.setattr(front.hub.jobs, "begin", hear)
        page.goto(address(front))
        yield page, told


def test_a_parameter_that_a_task_gets_is_a_field_of_its_form(begun):
    page, told = begun
    page.get_by_role("link", name="Calibrate").click()
    pause = page.get_by_label("Pause [s]")
    assert pause.input_value() == "1.5"
    assert page.get_by_text("Rest between two strokes.").is_visible()
    assert not violations(page)
    pause.fill("12")
    page.get_by_role("button", name="Begin").click()  # above its range: the browser says so
    assert pause.evaluate("input => input.validity.rangeOverflow") and not told
    pause.fill("2.25")
    page.get_by_label("Attempts").fill("3")
    page.get_by_label("Is loud").check()
    page.get_by_label("Voltages [V]").fill("60, 80.5")
    page.get_by_label("Name").fill("panel-7")
    page.get_by_role("button", name="Begin").click()
    wait_for(lambda: told)
    values = {"pause_s": 2.25, "tries": 3, "is_loud": True, "voltages_v": (60.0, 80.5)}
    assert told == [("calibration", {"name": "panel-7", "minutes": 3.0, **values})]


def test_a_form_with_fields_of_the_page_has_it_too(begun):
    page, told = begun
    page.get_by_role("link", name="Sit").click()
    page.get_by_label("Pause [s]").fill("4")
    page.get_by_label("Practice first").uncheck()
    page.get_by_role("button", name="Begin").click()
    page.get_by_role("button", name="I am ready").click()
    wait_for(lambda: told)
    ((kind, fields),) = told
    assert kind == "experiment" and fields["recipe"]["name"] == "ripple-20-Hz"
    assert (fields["pause_s"], fields["tries"], fields["participant"]) == (4.0, 2, 1)


def test_what_the_service_refuses_stands_in_the_form(begun):
    page, told = begun
    page.get_by_role("link", name="Calibrate").click()
    page.get_by_label("Voltages [V]").fill("60, x")
    page.get_by_label("Name").focus()
    assert page.get_by_label("Voltages [V]").evaluate("input => input.validity.customError")
    page.get_by_label("Voltages [V]").fill("60")
    page.get_by_label("Name").evaluate("input => input.removeAttribute('pattern')")
    page.get_by_label("Name").fill("no such/name")
    page.get_by_role("button", name="Begin").click()
    page.get_by_role("alert").filter(has_text="name:").wait_for()
    assert not told and any("422" in error for error in page.expected_errors)
    page.expected_errors.clear()


@pytest.fixture
def tasks(tmp_path, monkeypatch, browser):
    """The page of tasks, of a service that has one more task in one file."""
    (tmp_path / "stranger").mkdir()
    put_in(tmp_path / "stranger", monkeypatch)
    with a_front(tmp_path) as front, a_page(browser) as page:
        front.hub.jobs.results = tmp_path / "results"
        page.goto(address(front))
        page.get_by_role("link", name="Tasks").click()
        yield page
    sys.modules.pop("charging", None)


def test_a_task_in_one_file_has_a_form_a_job_a_result_and_files(tasks):
    tasks.get_by_role("link", name="Charge").click()
    tasks.get_by_text("Charge of a capacitor at some voltages.").wait_for()
    assert tasks.get_by_label("Width [mm]").input_value() == "10"
    assert tasks.get_by_text("What was measured.").count() == 0  # a file of the service's machine
    tasks.get_by_label("Voltage [V]").fill("1, 2")
    tasks.get_by_label("Width [mm]").fill("20")
    tasks.get_by_role("button", name="Begin").click()
    tasks.get_by_role("heading", name="Done").wait_for()
    assert tasks.locator(".jobs td").all_inner_texts() == ["1", "4e-10", "2", "8e-10"]
    assert tasks.locator(".jobs dd").all_inner_texts() == ["8e-10"]
    with tasks.expect_download() as download:
        tasks.get_by_role("link", name="charges.csv").click()
    assert download.value.path().read_text() == "voltage_v,charge_c\n1,4e-10\n2,8e-10\n"
    for width in (1280, 768, 420):
        tasks.set_viewport_size({"width": width, "height": 900})
        assert not violations(tasks)
        assert tasks.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        keep(tasks, f"tasks-{width}")


def test_what_a_task_refuses_stands_on_the_page_and_a_job_can_be_ended(tasks):
    tasks.get_by_role("link", name="Charge").click()
    tasks.get_by_label("Voltage [V]").fill("-1")
    tasks.get_by_role("button", name="Begin").click()
    tasks.get_by_role("alert").filter(has_text="voltage_v").wait_for()
    assert any("422" in error for error in tasks.expected_errors)
    tasks.expected_errors.clear()
    tasks.get_by_label("Voltage [V]").fill("1")
    tasks.get_by_role("button", name="Begin").click()
    tasks.get_by_role("button", name="Cancel").click()
    tasks.get_by_role("heading", name="Cancelled").wait_for()
