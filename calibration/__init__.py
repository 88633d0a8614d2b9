"""Calibration of one screen: plan, measure, reduce, fit, verify; each step can be repeated.

What comes out is a profile that `haptix.Screen.load` reads. The names below load on first use, so
that the command line's help does not wait for torch.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibration.column_map import ColumnMap
    from calibration.comparison import compare_terms
    from calibration.design import short_protocol
    from calibration.fitting import Fit, fit_strokes
    from calibration.measuring import measure
    from calibration.parameters import Parameters
    from calibration.predict import StrokePredictor
    from calibration.profile import calibrated_finger, calibrated_screen, write_screen_profile
    from calibration.protocol import Protocol, Stroke, full_protocol, paper_protocol
    from calibration.recording import Recording
    from calibration.reduction import Reduced, reduce_session
    from calibration.report import write_report
    from calibration.session import Session, SessionInfo
    from calibration.sources import AnalogSource, CsvSource
    from calibration.verification import Verification, verify
    from calibration.virtual import VirtualFingerSource

_HOME = {
    "AnalogSource": "sources",
    "ColumnMap": "column_map",
    "CsvSource": "sources",
    "Fit": "fitting",
    "Parameters": "parameters",
    "Protocol": "protocol",
    "Recording": "recording",
    "Reduced": "reduction",
    "Session": "session",
    "SessionInfo": "session",
    "Stroke": "protocol",
    "StrokePredictor": "predict",
    "Verification": "verification",
    "VirtualFingerSource": "virtual",
    "calibrated_finger": "profile",
    "calibrated_screen": "profile",
    "compare_terms": "comparison",
    "fit_strokes": "fitting",
    "full_protocol": "protocol",
    "measure": "measuring",
    "paper_protocol": "protocol",
    "reduce_session": "reduction",
    "short_protocol": "design",
    "verify": "verification",
    "write_report": "report",
    "write_screen_profile": "profile",
}

__all__ = [
    "AnalogSource",
    "ColumnMap",
    "CsvSource",
    "Fit",
    "Parameters",
    "Protocol",
    "Recording",
    "Reduced",
    "Session",
    "SessionInfo",
    "Stroke",
    "StrokePredictor",
    "Verification",
    "VirtualFingerSource",
    "calibrated_finger",
    "calibrated_screen",
    "compare_terms",
    "fit_strokes",
    "full_protocol",
    "measure",
    "paper_protocol",
    "reduce_session",
    "short_protocol",
    "verify",
    "write_report",
    "write_screen_profile",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'calibration' has no attribute {name!r}")
    value = getattr(import_module(f"calibration.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
