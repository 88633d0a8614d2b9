"""An experiment logs that it plays, and nothing of what is asked or answered."""

import logging

import numpy as np

from firmware_io import open_device
from haptix.lab.experiment import ConstantStimuli, Experiment, Presentation


def test_intervals_are_logged_and_no_answer(tmp_path, caplog):
    caplog.set_level(logging.DEBUG, "haptix")
    device = open_device("mock:")
    wave = np.sin(2 * np.pi * np.arange(96) / 48)
    answers = []

    def answer(question):
        answers.append(question.right)
        return question.right

    run = Experiment(
        ConstantStimuli([20.0, 30.0], 2),
        Presentation(lambda level: 10.0 * wave, 0 * wave, lambda level: 10.0),
        device, answer, tmp_path / "t.tsv", wait=lambda seconds: None,
    )  # fmt: skip
    run.run()
    device.close()
    assert len(answers) == 4
    assert [record.getMessage() for record in caplog.records if "haptix" in record.name] == [
        "an interval of 96 samples begins"
    ] * 8
