"""Rehearsal: a recorded finger feels what the renderer plays, and the error is split."""

from haptix.rehearsal.rehearse import PARTS, Rehearsal, rehearse

__all__ = ["PARTS", "Rehearsal", "rehearse"]
