"""Touch: from a touchscreen's reports to the finger's place and normal force now."""

from haptix.play.touch.events import (
    AppClock,
    AreaProxy,
    ForceEstimate,
    ForceModel,
    TouchCounts,
    TouchEvent,
    events_of,
    paced,
)
from haptix.play.touch.filters import (
    ConstantVelocityKalman,
    InteractingSinger,
    OneEuroFilter,
    PlaceFilter,
    SingerKalman,
)
from haptix.play.touch.listing import TouchscreenInfo, find_touchscreens
from haptix.play.touch.orientation import ORIENTATIONS, fitted_matrix, system_matrix
from haptix.play.touch.recordings import is_recording, paths_of, read_events, read_recording
from haptix.play.touch.touches import Touches, TouchSettings, TouchState, TouchTracker
from haptix.play.touch.touchscreen import (
    AxisRange,
    PanelClock,
    ScreenAxes,
    SlotDecoder,
    Touchscreen,
)
from haptix.play.touch.tuio import TuioDecoder, TuioSource

__all__ = [
    "ORIENTATIONS",
    "AppClock",
    "AreaProxy",
    "AxisRange",
    "ConstantVelocityKalman",
    "ForceEstimate",
    "ForceModel",
    "InteractingSinger",
    "OneEuroFilter",
    "PanelClock",
    "PlaceFilter",
    "ScreenAxes",
    "SingerKalman",
    "SlotDecoder",
    "TouchCounts",
    "TouchEvent",
    "TouchSettings",
    "TouchState",
    "TouchTracker",
    "Touches",
    "Touchscreen",
    "TouchscreenInfo",
    "TuioDecoder",
    "TuioSource",
    "events_of",
    "find_touchscreens",
    "fitted_matrix",
    "is_recording",
    "paced",
    "paths_of",
    "read_events",
    "read_recording",
    "system_matrix",
]
