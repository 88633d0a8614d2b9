"""The setting that the benchmarks of live rendering share: the demo's path on a photograph."""

from __future__ import annotations

import numpy as np
import torch
from skimage.data import brick

import haptix
from haptix.feel.motion import Trajectory
from haptix.play.simulation import FINGER_PATH, Setting


def demo_setting(seconds: float) -> tuple[Setting, haptix.FrictionSurface]:
    """Return a semi-wet finger on a brick wall for some seconds, and its surface; one thread."""
    torch.set_num_threads(1)
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    texture = haptix.Texture.from_image(brick(), width_mm=60)
    setting = Setting(model, texture, long_path(seconds))
    return setting, setting.surface()[0]


def long_path(seconds: float) -> Trajectory:
    """The demo's path to and fro, until the time is over."""
    path = Trajectory.from_csv(FINGER_PATH)
    parts = [(path.t_s, path.x_mm, path.y_mm, path.normal_force_n)]
    length_s = float(path.t_s[-1])
    back = (length_s - path.t_s[::-1], *(row[::-1] for row in parts[0][1:]))
    rows = [(parts[0], back)[turn % 2] for turn in range(1 + int(seconds / length_s))]
    columns = []
    for turn, (t, *rest) in enumerate(rows):
        keep = slice(1 if turn else 0, None)
        columns.append([(t + turn * length_s)[keep], *(row[keep] for row in rest)])
    return Trajectory(*(np.concatenate(column) for column in zip(*columns, strict=True)))
