"""Every figure's data, and one folder of drawn figures, shared by the tests."""

import pytest

import haptix.figures.folder as folder_module
from haptix.figures import FIGURES, write_figures


@pytest.fixture(scope="session")
def figures():
    """Data of every figure by name."""
    return {name: make() for name, make in FIGURES.items()}


@pytest.fixture(scope="session")
def drawn(figures, tmp_path_factory):
    """A folder that `write_figures` has filled, and what it returned."""
    folder = tmp_path_factory.mktemp("figures") / "deep" / "out"
    stages = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(folder_module, "FIGURES", {n: lambda d=d: d for n, d in figures.items()})
        written = write_figures(folder, lambda stage, share: stages.append((stage, share)))
    assert stages[-1] == ("write", 1.0)
    return folder, written
