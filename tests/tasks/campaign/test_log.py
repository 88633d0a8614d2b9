"""A campaign logs how tasks end, and which are done again."""

import logging
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool

from haptix.tasks.campaign import run_campaign
from haptix.tasks.campaign.task_worker import do
from tests.tasks.campaign.countable import Countable


class DiesOnce(Executor):
    """Does calls here; of the first task the worker is lost."""

    is_lost = False

    def submit(self, work, /, *given, **named):
        future = Future()
        if self.is_lost or work is not do:  # but questions about the worker
            future.set_result(work(*given, **named))
        else:
            self.is_lost = True
            future.set_exception(BrokenProcessPool("a worker ended"))
        return future


def test_what_is_done_again_is_told(tmp_path, caplog):
    caplog.set_level(logging.INFO, "haptix.tasks.campaign")
    plan = Countable(name="squares", kind="tests.tasks.campaign.countable:Countable", numbers=2)
    done = run_campaign(plan, tmp_path, DiesOnce())
    first, second = (str(row["key"]) for row in done.rows)
    told = [record.getMessage() for record in caplog.records]
    assert [text for text in told if first in text] == [
        f"task {first}: its worker is lost, it is done again: a worker ended",
        f"task {first}: done",
    ]
    # Which of two calls that have ended is looked at first is left open.
    assert [text for text in told if first not in text] == [f"task {second}: done"]
