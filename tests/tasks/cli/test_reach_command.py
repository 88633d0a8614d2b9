"""`haptix reach`: the numbers, by every door that one declaration has."""

import json

import pytest
from fastapi import FastAPI

import haptix
from haptix.model.status import Status
from haptix.model.surface import PULL_IN_SHARE
from haptix.service.front.rest import jobs_router
from haptix.service.worker.process import JobWork
from haptix.tasks.campaign.plans import load_campaign
from haptix.tasks.campaign.run import run_campaign
from tests.command_line import run_haptix
from tests.tasks.cli.test_desk import Board

COARSE = {"normal_force_n": [0.5, 2.0], "fidelity": "closed-form"}


@pytest.mark.parametrize(("finger", "frequency_hz"), [("semi-wet", 4000.0), ("wet", 125.0)])
def test_the_command_says_what_the_model_gives_up_to_its_limits(finger, frequency_hz):
    shown = run_haptix(
        *("reach", "--fidelity", "closed-form", "--normal-force-n", "0.5,2", "--json"),
        *("--finger", finger, "--frequency-hz", f"{frequency_hz:g}"),
    )
    assert shown.code == 0, shown.err
    of_finger, screen = haptix.Finger.preset(finger), haptix.Screen.preset("3m-sct3250")
    model = haptix.ContactModel(of_finger, screen, fidelity="closed-form")
    for row in json.loads(shown.out):
        force_n, voltage_v = row["normal_force_n"], row["voltage_v"]
        for volts, mu in ((0.0, row["mu_low"]), (voltage_v, row["mu_high"])):
            solved = model.solve(force_n, volts, frequency_hz)
            # The command's own tolerance of 0.02 JND, of 11 % of the friction each.
            assert mu == pytest.approx(float(solved.mu), rel=0.0022)
            assert Status(int(solved.status)) is Status.OK
        steps = (
            row["mu_high"] / row["mu_low"] - 1
        ) / haptix.model.perception.thresholds.WEBER_FRACTION
        assert row["range_jnd"] == pytest.approx(steps)
        if row["limited_by"] == "VOLTAGE":
            assert voltage_v == pytest.approx(screen.max_voltage_v)
        else:
            assert row["limited_by"] == "PULL_IN"
            end_v = PULL_IN_SHARE * float(solved.pull_in_voltage_v)
            assert voltage_v == pytest.approx(end_v, rel=1e-3)


def test_a_finger_that_is_past_the_limits_without_voltage_is_refused_unless_asked_for():
    dry = "reach", "--finger", "dry", "--fidelity", "closed-form"
    refused = run_haptix(*dry)
    assert refused.code == 2 and "--past-limits" in refused.err
    assert run_haptix(*dry, "--past-limits").code == 0


def test_the_service_a_job_and_a_campaign_do_it_too(tmp_path):
    app = FastAPI()
    app.include_router(jobs_router(Board()))
    route = app.openapi()["paths"]["/v1/reaches"]["post"]
    assert route["x-task"] == "reach"  # from which the studio makes its form
    used = {"finger": "wet", "screen": "3m-sct3250"}
    context = {"assets": str(tmp_path), "results": str(tmp_path / "results"), **used}
    rows = JobWork(context, lambda **fields: None, iter(())).reach(**COARSE)["rows"]
    assert [row["normal_force_n"] for row in rows] == [0.5, 2.0] and rows[0]["finger"] == "wet"
    (tmp_path / "plan.toml").write_text(
        'name = "reach"\nkind = "haptix.tasks.surfaces:Reach"\n'
        '[task]\nfidelity = "closed-form"\nnormal_force_n = ["0.5 N"]\n'
        '[vary]\nfinger = ["wet", "semi-wet"]\n'
    )
    done = run_campaign(load_campaign(tmp_path / "plan.toml"), tmp_path / "out")
    wet, semi_wet = (row["mu_low"] for row in done.rows)
    assert wet == pytest.approx(rows[0]["mu_low"]) and semi_wet != pytest.approx(wet)
