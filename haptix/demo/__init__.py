"""The main job, end to end: a photograph, a finger, a surface, a device, and what came of it."""

from haptix.demo.job import DemoJob, DemoResult

__all__ = ["DemoJob", "DemoResult"]
