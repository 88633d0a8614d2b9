"""Version of the distribution, and a check that its other packages belong to it."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

__version__ = "0.1.0.dev0"


def foreign_package(name: str) -> str:
    """Return advice about a foreign package of this name, or ""."""
    expected = Path(__file__).parents[2] / name / "__init__.py"
    spec = find_spec(name)
    if spec and spec.origin and expected.exists() and expected.samefile(spec.origin):
        return ""
    places = [*(spec.submodule_search_locations or [str(spec.origin)])] if spec else ["none"]
    return (
        f"{name}: expected the package that came with haptix, {expected.parent}, got {places[0]}; "
        "rename that one, take it off PYTHONPATH, or install haptix in an environment of its own"
    )
