"""From logs, or a study in the form of BIDS, to thresholds, scales and a report."""

from haptix.stimuli.analysis.results import Analysis, analyse
from haptix.stimuli.analysis.session_files import LoggedSession, read_sessions

__all__ = ["Analysis", "LoggedSession", "analyse", "read_sessions"]
