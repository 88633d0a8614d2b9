"""A participant at the page, and an experimenter who looks on; the experiment's process is played.

That a job of the service runs the product's own experiment is tested with the jobs.
"""

import json
import shutil
import subprocess
from typing import Any

import pytest

from haptix.lab.experiment.recipe import ExperimentRecipe
from haptix.lab.experiment.session_plan import TASKS
from haptix.service.front.jobs import Job
from haptix.service.protocol.messages import JobMessage
from haptix.tasks.stimuli import refuse_files_and_volts
from tests.studio.conftest import ROOT, address, keep, violations


class Played:
    """Stands for the processes of jobs: each asks a number of trials, and ends."""

    def __init__(self, front):
        self.front, self.begun, self.given = front, [], []
        board = front.hub.jobs
        board.begin = self.begin
        self.board = board

    def begin(self, kind, owner, recipe=None, log="", participant=1):
        message = JobMessage(job=f"{len(self.begun) + 1:x}", kind=kind, state="queued")
        job = Job(owner, message, {}, self.board._tell)
        played: Any = job
        played.tell = self.hear
        self.board.jobs[message.job] = job
        self.begun.append((job, recipe, log))
        return message

    def hear(self, do, text):
        self.given.append(text)

    def asks(self, page, job, choices=("1", "2")):
        job.change(state="running")
        page.get_by_text("Slide and feel").wait_for()
        job.change(state="asking", prompt="Which one?", choices=choices)


def test_a_calibration_asks_is_answered_and_reports(front, page):
    played = Played(front)
    played.board.begin = lambda kind, owner, name, minutes: played.begin(kind, owner, {}, name)
    page.add_init_script(KEEP_PLOTS)
    page.goto(address(front))
    page.get_by_role("link", name="Calibrate").click()
    page.get_by_role("button", name="Begin").click()
    job, _, name = begun(page, played, 1)
    assert (job.message.kind, name) == ("calibration", "practice")
    choices = ("go", "repeat the last one", "stop")
    job.on_message({"step": "measure"})
    job.change(state="asking", share=0.25, prompt="Press with 0.5 N.", choices=choices)
    page.get_by_text("Press with 0.5 N.").wait_for()
    assert page.locator('.steps [aria-current="step"]').inner_text() == "Strokes"
    assert page.evaluate("document.activeElement.textContent") == "Go"  # by keyboard throughout
    page.keyboard.press("Enter")
    until_given(page, played, ["go"])
    for begin_s in (0.0, 1.0):
        job.on_message({"trace": trace(begin_s)})
    page.get_by_role("heading", name="Stroke 3, attempt 2").wait_for()
    # Both parts are one curve: over 1.95 s, with 0.5 N and 40 mm/s as told.
    page.wait_for_function("() => window.plots.at(-1).data[0].length === 40")
    forces, speed = page.evaluate(f"({READ_PLOTS})()")
    assert speed["t"] == forces["t"]
    assert forces["t"] == pytest.approx([*trace(0.0)["t_s"], *trace(1.0)["t_s"]])
    assert set(forces["curves"][2]) == {0.5} and set(forces["curves"][3]) == {0.2}
    assert set(speed["curves"][2]) == {40.0}
    assert forces["curves"][0][0] == pytest.approx(0.85 * 0.52)  # the band of what was asked for
    assert not violations(page)
    keep(page, "calibrate")
    job.change(state="asking", prompt="Who measures?", choices=())
    page.get_by_label("Who measures?").fill("me")
    page.keyboard.press("Enter")
    until_given(page, played, ["go", "me"])
    job.change(state="done", share=1.0, result=REPORT)
    page.get_by_text("installed for driver MOCK0001").wait_for()
    page.get_by_text("118 nm: the profile is 5.9 % off").wait_for()
    assert not violations(page)
    keep(page, "calibrate-report")


KEEP_PLOTS = """
    let made;
    window.plots = [];
    Object.defineProperty(window, "uPlot", {
        get: () => made,
        set: (Plot) => (made = new Proxy(Plot, { construct: (Plain, given) => {
            const one = new Plain(...given);
            window.plots.push(one);
            return one;
        } })),
    });"""
READ_PLOTS = """() => window.plots.slice(-2).map(
    ({ data: [t, ...curves] }) => ({ t: [...t], curves: curves.map((one) => [...one]) }))"""
REPORT = {
    "name": "practice",
    "still_open": [],
    "verdict": "passed",
    "worst_jnd": 0.4,
    "strokes_used": 16,
    "h0_nm": 125.0,
    "installed_for": "MOCK0001",
    "practice": {
        "true_h0_nm": 118.0,
        "h0_error": 0.059,
        "friction_error_median_jnd": 0.1,
        "friction_error_worst_jnd": 0.3,
    },
}


def trace(begin_s):
    """What the service tells of a second of a stroke."""
    t_s = [begin_s + 0.05 * k for k in range(20)]
    values = {"normal_force_n": 0.5, "tangential_force_n": 0.2, "speed_mm_per_s": 40.0}
    rows = {"t_s": t_s} | {name: [value] * 20 for name, value in values.items()}
    asked = {"asked_normal_force_n": 0.52, "asked_speed_mm_per_s": 50.0}
    return {"stroke": 3, "tries": 1, **asked, **rows}


def until_given(page, played, given):
    for _ in range(600):
        if played.given == given:
            return
        page.wait_for_timeout(50)
    pytest.fail(f"answered: {played.given}")


def begins(front, page):
    page.goto(address(front))
    page.get_by_role("link", name="Sit").click()
    page.get_by_role("button", name="Begin").click()
    page.get_by_text("Rest a fingertip").wait_for()


def begun(page, played, count):
    for _ in range(600):
        if len(played.begun) == count:
            return played.begun[-1]
        page.wait_for_timeout(50)
    pytest.fail("no experiment was begun")


def test_from_instructions_by_practice_and_trials_to_thanks(front, page):
    played = Played(front)
    begins(front, page)
    assert not violations(page)
    page.keyboard.press("Space")
    practice, recipe, log = begun(page, played, 1)
    assert log.endswith("-practice") and recipe["method"]["kind"] == "constant-stimuli"
    played.asks(page, practice)
    page.get_by_role("button", name="the first").wait_for()
    keep(page, "sit")
    assert not violations(page)
    page.keyboard.press("2")
    until_given(page, played, ["2"])
    practice.change(state="done", result={"trials": 1})
    page.get_by_text("That was the practice").wait_for()
    page.keyboard.press("Space")
    job, recipe, log = begun(page, played, 2)
    assert recipe["method"]["kind"] == "quest+" and not log.endswith("-practice")
    for trial in range(3):
        played.asks(page, job)
        page.get_by_role("button", name="the first").wait_for()
        page.keyboard.press("Space")  # by habit: no answer
        page.get_by_text(f"Trial {trial + 1}.").wait_for()
        page.get_by_role("button", name="the first").click()
        page.get_by_role("button", name="the first").wait_for(state="detached")
        until_given(page, played, ["2"] + ["1"] * (trial + 1))
    looks = page.context.new_page()
    looks.goto(f"http://127.0.0.1:{front.port}/#/sit")
    looks.get_by_text("plays").or_(looks.get_by_text("asks the participant")).first.wait_for()
    looks.close()
    found = {"trials": 3, "threshold_db": -14.2, "low_db": -17.0, "high_db": -11.6}
    job.change(state="done", result=found)
    page.get_by_text("3 trials were counted").wait_for()
    page.keyboard.press("Space")
    page.get_by_text("threshold -14.2 dB (95 %: -17.0 to -11.6)").wait_for()


def test_stop_ends_the_experiment_and_says_so(front, page):
    played = Played(front)
    begins(front, page)
    page.keyboard.press("Space")
    job, _, _ = begun(page, played, 1)
    played.asks(page, job)
    page.get_by_role("button", name="the first").wait_for()
    page.keyboard.press("F8")
    page.get_by_text("the experiment was ended").wait_for()
    assert job.message.state == "cancelled"


def test_every_task_of_the_product_is_sat(front, page, tmp_path):
    """Its own question and answers by keys; a number, a rest and feedback where there are some."""
    played = Played(front)
    page.goto(address(front))
    page.get_by_role("link", name="Sit").click()
    page.get_by_label("Experiment", exact=True).select_option("")
    page.get_by_label("Practice first").uncheck()
    given = []
    for number, (task, known) in enumerate(TASKS.items(), start=1):
        recipe = tmp_path / f"{task}.json"
        recipe.write_text(json.dumps({"name": task, "task": task, "break_every": 5, "method": {}}))
        page.get_by_label("Recipe", exact=True).set_input_files(recipe)
        page.get_by_label("Number of the participant").fill("7")
        page.get_by_role("button", name="Begin").click()
        page.get_by_text("Rest a fingertip").wait_for()
        page.keyboard.press("Space")
        job, asked, _ = begun(page, played, number)
        assert asked["task"] == task
        played.asks(page, job, known.choices)
        if known.choices:
            page.locator(".choice").last.wait_for()
            shown = [one.get_attribute("data-key") for one in page.locator(".choice").all()]
            assert tuple(shown) == known.choices
            assert not set(page.locator(".choice").all_inner_texts()) & set(known.choices)  # words
            given.append(known.choices[-1])
            page.keyboard.press(known.choices[-1])
        else:
            page.get_by_label("Your number").fill("0")
            page.keyboard.press("Enter")  # no magnitude: not sent
            page.get_by_label("Your number").fill("12.5")
            assert not violations(page)
            keep(page, "sit-number")
            given.append("12.5")
            page.keyboard.press("Enter")
        until_given(page, played, given)
        if task == "yes-no":
            old = "The last trial of a.csv was 30 hours ago. Does the same person go on?"
            job.change(state="asking", prompt=old, choices=("no", "yes"))
            page.get_by_text(old).wait_for()
            assert not page.get_by_text("Trial 2").count()
            page.get_by_role("button", name="yes").click()
            given.append("yes")
            until_given(page, played, given)
            job.on_message({"step": "wrong"})
            page.get_by_text("That was not right.").wait_for()
            job.change(state="asking", prompt="Rest a moment", choices=("continue",))
            page.get_by_text("Rest your hand").wait_for()
            page.keyboard.press("Space")
            given.append("continue")
            until_given(page, played, given)
        job.change(state="done", result={"trials": 1})
        page.get_by_text("1 trial was counted").wait_for()
        page.keyboard.press("Space")


def test_the_page_s_recipes_are_those_of_the_command():
    if shutil.which("node") is None:
        pytest.skip("needs node")
    path = ROOT / "haptix" / "studio" / "static" / "experiments.js"
    script = (
        f"import {{EXPERIMENTS, practiceOf}} from {json.dumps(str(path))};"
        "const all = Object.values(EXPERIMENTS);"
        "console.log(JSON.stringify([...all, ...all.map(practiceOf)]))"
    )
    done = subprocess.run(
        ["node", "--input-type=module", "-e", script], capture_output=True, text=True, check=True
    )
    for recipe in json.loads(done.stdout):
        refuse_files_and_volts(recipe)
        assert ExperimentRecipe(**recipe).make_method().level <= 0
