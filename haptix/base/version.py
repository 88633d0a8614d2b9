"""Version of the distribution, its code as a hash, and a check that its packages belong to it."""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

__version__ = "0.1.0.dev0"

_ROOT = Path(__file__).parents[2]
_SOURCES = (".py", ".c", ".h", ".toml")


@cache
def code_digest(*folders: str) -> str:
    """Return a hash of the sources in Python and C, and of their tables, below these folders.

    Results that depend on no other code are kept or compared under it. A bundle without sources has
    the hash of nothing: there its version decides.

    Parameters
    ----------
    *folders : str
        Folders of the distribution, such as ``haptix/model``.
    """
    code = sha256()
    for folder in folders:
        for file in sorted((_ROOT / folder).rglob("*.*")):
            if file.suffix in _SOURCES:
                code.update(file.relative_to(_ROOT).as_posix().encode() + b"\0")
                code.update(sha256(file.read_bytes()).digest())
    return code.hexdigest()


def foreign_package(name: str) -> str:
    """Return advice about a foreign package of this name, or ""."""
    expected = _ROOT / name / "__init__.py"
    spec = find_spec(name)
    if spec and spec.origin and expected.exists() and expected.samefile(spec.origin):
        return ""
    places = [*(spec.submodule_search_locations or [str(spec.origin)])] if spec else ["none"]
    return (
        f"{name}: expected the package that came with haptix, {expected.parent}, got {places[0]}; "
        "rename that one, take it off PYTHONPATH, or install haptix in an environment of its own"
    )
