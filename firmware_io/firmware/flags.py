"""How the firmware is compiled for a desktop: by `build` at first use, and into wheels."""

from __future__ import annotations

SOURCES = (
    "haptix_wire.c",
    "haptix_receive.c",
    "haptix_session.c",
    "haptix_answer.c",
    "haptix_play.c",
    "haptix_window.c",
)

#: For hosts alone.
HOST_SOURCES = ("haptix_host.c",)

#: A desktop has memory for the longest frame of the format and a queue of 2.7 s at 48 kHz.
QUEUE_SAMPLES = 1 << 17
FRAME_SAMPLES = 32765
FLAGS = (
    "-std=c99",
    "-O2",
    "-shared",
    f"-DHX_QUEUE_SAMPLES={QUEUE_SAMPLES}u",
    f"-DHX_MAX_FRAME_SAMPLES={FRAME_SAMPLES}u",
)
