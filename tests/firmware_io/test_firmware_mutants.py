"""The tests notice each safety line of the firmware that is wrong; see firmware/mutants.py."""

import sys
from pathlib import Path

import pytest

from tests.firmware_io.firmware.mutants import (
    CORE,
    IN_C_ALONE,
    IN_PYTHON_ALONE,
    MUTANTS,
    SENSING,
    Mutant,
    survives,
)

HERE = Path(__file__).parent
#: What finds most of them first.
TESTS = (
    "test_conformance_refusals.py",
    "test_conformance_output.py",
    "test_conformance.py",
    "test_output_slew.py",
    "test_revisions_on_the_wire.py",
    "test_output_window.py",
    "test_differential.py",
    "test_sensing_driver.py",
)
PYTEST = [
    *(sys.executable, "-m", "pytest", "-q", "-x", "-p", "tests.firmware_io.firmware.mutated"),
    *(str(HERE / name) for name in TESTS),
]
OF_SENSING = ["-k", "golden or measure or sens or converter or panel or current"]


def test_the_list_follows_the_core():
    assert len(MUTANTS) >= 40
    for mutant in MUTANTS + IN_PYTHON_ALONE:
        assert (CORE / mutant.file).read_text().count(mutant.text) == 1, mutant


@pytest.mark.slow
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: f"{mutant.file}: {mutant.text}")
def test_each_mutant_fails_the_check_of_the_firmware_alone_and_the_tests(mutant):
    assert not survives(mutant)
    tests = PYTEST + OF_SENSING if mutant in SENSING else PYTEST
    assert mutant in IN_C_ALONE or not survives(mutant, tests)


@pytest.mark.slow
@pytest.mark.parametrize(
    "mutant", IN_PYTHON_ALONE, ids=lambda mutant: f"{mutant.file}: {mutant.text}"
)
def test_each_mutant_of_sensing_fails_the_tests(mutant):
    assert not survives(mutant, PYTEST + OF_SENSING)


@pytest.mark.slow
def test_the_core_as_it_is_passes_both():
    """All other tests of the list run in the ordinary run, with the package's own library."""
    same = Mutant(MUTANTS[0].file, MUTANTS[0].text, MUTANTS[0].text)
    assert survives(same)
    assert survives(same, [*PYTEST, "-k", "golden"])
