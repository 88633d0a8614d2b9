"""A whole practice at the page, as a newcomer makes it: strokes, fit, installed profile.

The page alone is tested with the participant's; that a stopped calibration is continued, and how
it is planned, with the jobs.
"""

import re

import pytest

from calibration.tasks import RunCalibration
from firmware_io import open_device
from haptix.model.finger import Finger
from haptix.model.friction import in_theory
from haptix.model.screen import Screen
from haptix.play.devices import profile_of
from haptix.service.front.jobs import Job
from tests.studio.conftest import a_page, address, keep

LONG_MS = 600_000  # of a busy machine: the fit takes half a minute of a free one


@pytest.mark.slow  # a virtual finger makes some 20 strokes, and they are fitted
def test_from_the_page_by_every_stroke_to_an_installed_profile(
    front, browser, tmp_path, monkeypatch
):
    monkeypatch.setenv("HAPTIX_PROFILES", str(tmp_path / "profiles"))
    monkeypatch.setenv("HAPTIX_CACHE", str(tmp_path / "cache"))
    # Beside other tests a job that gives way to everything takes minutes, and seems to hang.
    monkeypatch.setattr("haptix.service.front.jobs.NICE", 0)
    begun, change = [], Job.change

    def changed(job, **fields):
        begun.append(fields.get("step", ""))
        change(job, **fields)

    monkeypatch.setattr(Job, "change", changed)
    folder = tmp_path / "calibrations" / "panel-7"
    # A screen that is known to the test; the page continues what was planned under this name.
    # In the theory that is fitted 20 times as fast as the default, which the start page fits.
    finger = tmp_path / "finger.toml"
    in_theory(Finger.preset("semi-wet"), "open-gaps").save(finger)
    planned = {"folder": folder, "name": "panel-7", "practice": True, "minutes": 4.0, "seed": 6}
    RunCalibration(**planned, finger=str(finger)).begin()
    front.hub.jobs.context = {"device": "mock:", "calibrations": str(folder.parent)}
    with a_page(browser) as page:
        page.set_default_timeout(LONG_MS)
        page.goto(address(front))
        page.get_by_role("link", name="Calibrate").click()
        page.get_by_label("Name").fill("panel-7")
        page.get_by_role("button", name="Begin").click()
        asked, repeats = [], 0
        prompt, plots = page.locator(".set-up p.large"), page.locator(".uplot")
        while True:
            turn = page.get_by_role("heading", name=re.compile("Your turn|Done|Failed"))
            turn.wait_for()
            assert turn.inner_text() == "Your turn", page.locator("main").inner_text()
            said = prompt.inner_text()
            if "passed" in said:
                break
            asked.append(said)
            if len(asked) == 3:
                repeats += 1
                page.get_by_role("button", name="Repeat the last one").click()
            else:
                page.get_by_role("button", name="Go", exact=True).click()
            prompt.filter(has_text=said).wait_for(state="detached")
            assert plots.count() in (0, 2)
        # The third prompt was answered by a repeat: the second stroke was asked for again.
        assert asked[3].endswith(asked[1].removeprefix("Once more, please. "))
        assert "Install its profile for driver MOCK0001?" in said
        keep(page, "calibrate-install")
        page.get_by_role("button", name="Install it").click()
        page.get_by_text("installed for driver MOCK0001").wait_for()
        keep(page, "calibrate-report-whole")
        with page.expect_download() as download:
            page.get_by_role("button", name="Save the whole report").click()
        report = download.value.path().read_text()
    stages = ["measure", "fit", "verify", "install"]  # what the page shows as its steps
    assert [step for step in begun if step in stages] == stages
    assert "Calibration of panel-7" in report and "http" not in report.replace("http://www.w3", "")
    device = open_device("mock:")
    installed = profile_of(device)
    device.close()
    screen, finger = Screen.load(installed.screen), Finger.load(installed.finger)
    assert screen.name == "panel-7" and screen.calibration.verdict == "passed"
    assert screen.calibration.finger_hash == finger.content_hash()
    assert len(list((folder / "rejected").iterdir())) == 1  # the one that was repeated
