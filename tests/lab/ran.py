"""Runs of a method, without logs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from haptix.lab.analysis.runs import RunOfMethod
from haptix.lab.experiment import Method


def run_of(method: Method, who: str = "01") -> RunOfMethod:
    """A run of a participant who has answered a method."""
    session: Any = SimpleNamespace(participant=who, session="1", task="", source="simulated")
    return RunOfMethod(session, "", "", method, method.estimate(), (), {})
