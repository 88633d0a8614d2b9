"""How much the base takes on disk, and torch beside it, as installed in this environment.

    python benchmarks/installed_size.py

The base is what haptix (6 MB itself) brings without an extra. Torch's own dependencies that
haptix has no use for, such as those of CUDA, count as torch's.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement


def brought_by(name: str, found: set[str], without: frozenset[str] = frozenset()) -> set[str]:
    """Return the distributions that one brings here, itself among them."""
    try:
        needs = distribution(name).requires or []
    except PackageNotFoundError:  # another system's
        return found
    found.add(name)
    for line in needs:
        need = Requirement(line)
        if need.name.lower() in found | without or (need.marker and not need.marker.evaluate()):
            continue
        brought_by(need.name.lower(), found, without)
    return found


def megabytes(names: set[str]) -> float:
    """Return what the files of distributions take on disk."""
    kept = [Path(str(d.locate_file(f))) for d in map(distribution, names) for f in d.files or ()]
    return sum(path.stat().st_size for path in kept if path.is_file()) / 1e6


def main() -> None:
    """Print both."""
    base = brought_by("haptix-electrovibration", set(), frozenset({"torch"}))
    torch = brought_by("torch", set()) - base
    for name in sorted(base | torch, key=lambda one: -megabytes({one}))[:8]:
        print(f"{name:28} {megabytes({name}):5.0f} MB")
    print(f"the rest {megabytes(base):.0f} MB, torch {megabytes(torch):.0f} MB")


if __name__ == "__main__":
    main()
