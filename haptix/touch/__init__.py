"""Touch: from a touchscreen's reports to the finger's place and normal force now."""

from haptix.touch.clock import AppClock
from haptix.touch.events import TouchCounts, TouchEvent, events_of, paced, read_events
from haptix.touch.filters import (
    ConstantVelocityKalman,
    OneEuroFilter,
    PlaceFilter,
)
from haptix.touch.force import AreaProxy, ForceEstimate, ForceModel
from haptix.touch.settings import TouchSettings
from haptix.touch.singer import InteractingSinger, SingerKalman
from haptix.touch.slots import AxisRange, ScreenAxes, SlotDecoder
from haptix.touch.touches import Touches
from haptix.touch.touchscreen import Touchscreen, find_touchscreens
from haptix.touch.tracker import PathSegment, TouchState, TouchTracker

__all__ = [
    "AppClock",
    "AreaProxy",
    "AxisRange",
    "ConstantVelocityKalman",
    "ForceEstimate",
    "ForceModel",
    "InteractingSinger",
    "OneEuroFilter",
    "PathSegment",
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
    "events_of",
    "find_touchscreens",
    "paced",
    "read_events",
]
