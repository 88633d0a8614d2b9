"""What tests of several rooms share: the terminal, the command line, the paper's finger."""

import gc
import os
import signal
from collections.abc import Generator, Iterable, Iterator
from pathlib import Path

# Torch's threads wait for each other by spinning: on a busy machine the small arrays of these tests
# would take ten times as long with two threads as with one. Subprocesses inherit the variable.
os.environ["OMP_NUM_THREADS"] = "1"

import pytest
import torch
from hypothesis import settings
from xdist.remote import Producer
from xdist.scheduler import LoadFileScheduling

from haptix import ContactModel, Finger, Screen
from tests import skips
from tests.command_line import CommandLine, run_haptix
from tests.steady_clock import steady_driver

torch.set_num_threads(1)

# Some million objects live from the collection of the tests to their end: to look at them again and
# again takes a third of the time of the collection. What else it leaves is not looked for.
gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


# A shell starts `make test &` with Ctrl-C ignored, and so would every program that a test starts.
signal.signal(signal.SIGINT, signal.default_int_handler)

# A machine that is busy with other tests is no failure, and what passed once passes again: the
# examples follow from the test. `--hypothesis-profile="new examples"` looks for others.
settings.register_profile("any machine", deadline=None, derandomize=True)
settings.register_profile("new examples", deadline=None)
settings.load_profile("any machine")


#: "1" where nothing may be missing, as in CI: a skip is a failure there, unless it is optional.
NO_SKIPS = "HAPTIX_NO_SKIPS"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    may_skip = os.environ.get(NO_SKIPS) != "1" or item.get_closest_marker("optional")
    if report.skipped and not may_skip:
        report.outcome = "failed"
        why = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
        report.longrepr = f"{NO_SKIPS}=1, so this must run, but: {why}"
    return report


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    skipped = terminalreporter.stats.get("skipped", [])
    reasons = [one.longrepr[2] for one in skipped if isinstance(one.longrepr, tuple)]
    if line := skips.summary(reasons):
        terminalreporter.write_line(line)


#: Files that take half a minute: begun first, so that no process is left alone with one.
LONG_FIRST = (
    "test_researchers_day",
    "test_make",
    "test_differential",
    "test_documentation",
    "test_site_search",
    "test_calibrate",
    "test_soak",
    "test_processes",
    "test_cluster_faults",
    "test_whole_studio",
    "test_live_streams",
    "test_engine",
    "test_wheels",
    "test_play",
    "test_firmware_build",
    "test_types",
)

#: Folders whose files share what takes seconds to make: one process runs all of such a folder.
ONE_PROCESS = ("calibration", "lab", "model/surface", "plan/planning", "play/simulation")


#: Of whose time the most is waiting, for browsers, services, links and the clocks of these.
WAITING = (
    "clients",
    "firmware_io/test_audio_link",
    "firmware_io/test_serial_link",
    "firmware_io/test_stalls",
    "play/render/test_lab_streams",
    "play/render/test_own_thread",
    "service",
    "studio",
)


def unit(nodeid: str) -> str:
    """What one process runs as a whole: a file, or one of some folders."""
    file = nodeid.split("::")[0]
    folders = (one for one in ONE_PROCESS if file.startswith(f"tests/{one}/"))
    return next(folders, file)


def order(units: Iterable[str]) -> list[str]:
    """Long ones first, and those that wait among those that compute, so that no core is idle."""
    by_length = sorted(
        units, key=lambda one: one not in ONE_PROCESS and Path(one).stem not in LONG_FIRST
    )
    prefixes = tuple(f"tests/{one}" for one in WAITING)
    places = {}
    for waits in (True, False):
        alike = [one for one in by_length if one.startswith(prefixes) is waits]
        places |= {one: (place + 0.5) / len(alike) for place, one in enumerate(alike)}
    return sorted(places, key=places.__getitem__)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    places = {one: place for place, one in enumerate(order({unit(i.nodeid): 0 for i in items}))}
    items.sort(key=lambda item: places[unit(item.nodeid)])


@pytest.hookimpl(wrapper=True)
def pytest_xdist_auto_num_workers() -> Generator[None, int, int]:
    """Four processes for two cores: of these tests' time four tenths are spent waiting.

    In CI, where other steps run beside them, three.
    """
    cores = yield
    return cores + cores // 2 if os.environ.get("HAPTIX_NO_SKIPS") else 2 * cores


class ByFileOrFolder(LoadFileScheduling):  # type: ignore[misc]  # xdist has no types
    """A process runs whole files, and of some folders all files."""

    def _split_scope(self, nodeid: str) -> str:
        return unit(nodeid)


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> ByFileOrFolder | None:
    if config.getoption("dist") != "loadfile":
        return None
    # Otherwise xdist begins the files of most tests first: one long test alone would be the last.
    config.option.loadscopereorder = False
    return ByFileOrFolder(config, log)


@pytest.fixture(scope="session", autouse=True)
def plain_terminal() -> Iterator[None]:
    """A terminal of 80 columns without colours, whatever this one is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "80")
        patch.setenv("NO_COLOR", "1")
        patch.setenv("TERM", "dumb")
        for name in ("FORCE_COLOR", "CLICOLOR_FORCE", "PY_COLORS"):
            patch.delenv(name, raising=False)
        yield


@pytest.fixture(scope="session", autouse=True)
def no_waiting_for_the_disk() -> Iterator[None]:
    """What a test writes need not outlast a power cut, and a file is on a disk after 7 ms."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda file: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def no_certificates(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Each request of httpx, also without TLS, reads all certificates of the web for 20 ms."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SSL_CERT_DIR", str(tmp_path_factory.mktemp("certificates")))
        yield


@pytest.fixture(scope="session", autouse=True)
def frozen_objects_are_not_counted() -> Iterator[None]:
    """Each live rendering asks whether something is frozen, and to count millions takes 20 ms."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gc, "get_freeze_count", lambda: 1)
        yield


@pytest.fixture(scope="session")
def haptix_cli() -> CommandLine:
    """Call ``haptix ARGUMENTS``."""
    return run_haptix


@pytest.fixture
def private_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of this test's own, instead of the user's."""
    cache = tmp_path / "cache"
    monkeypatch.setenv("HAPTIX_CACHE", str(cache))
    return cache


@pytest.fixture
def own_folder(tmp_path: Path, private_cache: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, with a cache elsewhere."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def steady_mock(monkeypatch: pytest.MonkeyPatch) -> None:
    """``mock:pace=real`` is a driver that no stall of this machine starves."""
    monkeypatch.setattr("firmware_io.links.mock.MockDriver", steady_driver)


@pytest.fixture(scope="session")
def finger() -> Finger:
    return Finger.preset("semi-wet")


@pytest.fixture(scope="session")
def screen() -> Screen:
    return Screen.preset("3m-sct3250")


@pytest.fixture(scope="session")
def model(finger: Finger, screen: Screen) -> ContactModel:
    """The paper's finger on the paper's screen."""
    return ContactModel(finger, screen)
