"""One run of the demo job, shared; nothing here touches the user's cache."""

from types import SimpleNamespace

import numpy as np
import pytest
from skimage.io import imsave

import haptix.demo.job as job_module
from firmware_io import open_device
from haptix.demo import DemoJob

PATH = """t_s,x_mm,y_mm,normal_force_n
0.00,5,5,0.40
0.03,15,9,0.50
0.06,22,14,0.55
0.10,26,25,0.45
"""


@pytest.fixture(autouse=True)
def in_private_cache(private_cache):
    """Every run has a cache of its own."""


def write_inputs(folder):
    rows, columns = np.mgrid[0:64, 0:64]
    grey = 127 + 60 * np.sin(columns / 5) + 60 * np.cos(rows / 7)
    imsave(folder / "photo.png", grey.astype(np.uint8), check_contrast=False)
    (folder / "path.csv").write_text(PATH)


@pytest.fixture(scope="session")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo-inputs")
    write_inputs(folder)
    return folder


@pytest.fixture(scope="session")
def run(tmp_path_factory, inputs):
    """The job's result, the device it used, and the cache it filled."""
    cache = tmp_path_factory.mktemp("demo-cache")
    devices = []

    def opening(address):
        devices.append(open_device(address))
        return devices[-1]

    job = DemoJob(
        tmp_path_factory.mktemp("demo") / "deep" / "out",
        inputs / "photo.png",
        inputs / "path.csv",
        width_mm=30.0,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HAPTIX_CACHE", str(cache))
        patch.setattr(job_module, "open_device", opening)
        stages = []
        result = job.run(lambda stage, share: stages.append((stage, share)))
    (device,) = devices
    return SimpleNamespace(
        job=job, result=result, device=device, driver=device.mock, cache=cache, stages=stages
    )
