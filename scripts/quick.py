"""Run the tests that are nearest to the changed files, for a minute: `make quick`.

    .venv/bin/python scripts/quick.py                            # what differs from main
    .venv/bin/python scripts/quick.py haptix/model/screen.py -x  # these; options go to pytest

A test file covers a module that it imports, by itself, by the conftest.py of its folder or through
other modules: the fewer imports lie between, the earlier it runs. A file that is no Python is
covered by the tests that name it and by those of the package in which it lies. After a minute no
further test begins, and the last line counts the files that were left out, which are for
`make test`.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("haptix", "firmware_io", "calibration", "tests")
#: Read by a pattern: the syntax trees of all files would take five seconds of the minute.
IMPORT = re.compile(
    r"^[ \t]*(?:from (?P<module>\.*[\w.]*) import (?:\((?P<many>[^)]*)\)|(?P<few>[^\n(]+))"
    r"|import (?P<whole>[\w., ]+))",
    re.MULTILINE,
)
PROCESSOR = "--processor-time"  # a minute of the processor, however busy the machine is
SECONDS = 50.0  # of a minute; the rest is for the imports and for the test that is under way


def module_of(path: Path) -> str:
    """Return the dotted name of a file, relative to the repository."""
    return ".".join((*path.parts[:-1], path.stem)).removesuffix(".__init__")


NAMED = re.compile(r"[\"'](\w+(?:\.\w+)+)[\"':]")  # a module that is found by its name in a text


def imports_of(text: str) -> Iterator[tuple[str, str]]:
    """Yield the module and the name of each import; the name is empty where all is imported."""
    yield from ((name, "") for name in NAMED.findall(text))
    if "haptix_cli" in text:  # the one fixture of tests/conftest.py that most tests do without
        yield "tests.command_line", ""
    for found in IMPORT.finditer(text):
        for name in (found["many"] or found["few"] or found["whole"]).split(","):
            bare = name.partition("#")[0].strip().partition(" as ")[0]
            if bare.replace(".", "").isidentifier():
                yield (found["module"], bare) if found["module"] else (bare, "")


class Imports:
    """Who imports whom, in the packages and in the tests, names that load on first use included."""

    def __init__(self, root: Path = ROOT) -> None:
        def files(ending: str) -> dict[str, Path]:
            paths = (file for folder in FOLDERS for file in (root / folder).rglob(ending))
            return {module_of(path): path for path in (one.relative_to(root) for one in paths)}

        self.root = root
        self.files = files("*.py")
        self.texts = {name: (root / file).read_text("utf-8") for name, file in self.files.items()}
        #: Where names that load on first use are defined: haptix.Finger in haptix.model.finger.
        self.public: dict[str, str] = {}
        for package, stub in files("*.pyi").items():
            for module, name in imports_of((root / stub).read_text("utf-8")):
                at = ".".join(filter(None, [package, module.lstrip("."), name]))
                if at != f"{package}.{name}":
                    self.public[f"{package}.{name}"] = at
        self.importers: dict[str, set[str]] = defaultdict(set)
        for importer, text in self.texts.items():
            for module, name in imports_of(text):
                self.importers[self.defined(f"{module}.{name}".strip("."))].add(importer)
        for name, file in self.files.items():  # the fixtures of a folder are its tests' own
            folder = module_of(file.with_name("conftest.py"))
            if file.stem.startswith("test_") and folder in self.files:
                self.importers[folder].add(name)

    def defined(self, name: str) -> str:
        """Return the module in which a dotted name is defined."""
        while name and name not in self.files:
            name = self.public.get(name, name.rpartition(".")[0])
        return name

    def steps(self, changed: Iterable[str]) -> dict[str, int]:
        """Return how many imports lie between changed modules and each that they reach."""
        found = dict.fromkeys(changed, 0)
        waiting = list(found)
        for name in waiting:  # grows on the way: the nearest first
            for importer in self.importers[name]:
                if importer not in found:
                    found[importer] = found[name] + 1
                    waiting.append(importer)
        return found


def changed_files() -> list[Path]:
    """Return what differs from where this branch left main, and what is new."""

    def git(*arguments: str) -> str:
        return subprocess.run(
            ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.strip()

    base = git("merge-base", "HEAD", "main")
    names = git("diff", "--name-only", base) + "\n" + git("ls-files", "-o", "--exclude-standard")
    return [Path(name) for name in names.split("\n") if name and (ROOT / name).exists()]


def tests_near(files: Iterable[Path], imports: Imports) -> list[Path]:
    """Return the test files that cover files, the nearest first."""
    tests = {name: file for name, file in imports.files.items() if file.stem.startswith("test_")}
    distance: dict[str, float] = {}
    for file in files:
        module = module_of(file)
        while module not in imports.files and module:
            module = module.rpartition(".")[0]
        near: dict[str, float] = dict(imports.steps([module])) if module else {}
        if file.suffix != ".py":
            word = re.escape(file.name if near or len(file.parts) == 1 else file.parts[0])
            near |= {name: 1 for name in tests if re.search(rf"\b{word}\b", imports.texts[name])}
        for name in tests:
            # The tests mirror the packages: those of the same folder are about this file.
            mirrors = tests[name].parent.name in file.parts
            alike = file.stem in tests[name].stem
            if name in near or mirrors:
                steps = near.get(name, 1) - 1.5 * mirrors - 0.5 * alike
                distance[name] = min(steps, distance.get(name, steps))
    # Of equals, first those that import little else.
    sizes = {name: len(set(imports_of(imports.texts[name]))) for name in distance}
    order = sorted(distance, key=lambda name: (distance[name], sizes[name], name))
    return [tests[name] for name in order]


class ForAMinute:
    """Lets no test begin after some seconds, and says which files were left out."""

    def __init__(
        self, order: list[Path], seconds: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.order = {path: number for number, path in enumerate(order)}
        self.clock, self.end = clock, clock() + seconds
        self.left_out: set[Path] = set()

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Put the nearest first, after tests/conftest.py has put the longest first."""
        items.sort(key=lambda item: self.order[item.path])

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> bool | None:
        """Run a test while there is time."""
        if self.clock() < self.end:
            return None
        self.left_out.add(item.path)
        return True  # done, without a report

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Count what was left out."""
        if self.left_out:
            terminalreporter.write_line(
                f"the minute is over: tests of {len(self.left_out)} files further from the change "
                "were left out; make test runs all"
            )


def main() -> int:
    """Find the tests and run them."""
    named = [Path(one) for one in sys.argv[1:] if (ROOT / one).is_file()]
    options = [one for one in sys.argv[1:] if not (ROOT / one).is_file() and one != PROCESSOR]
    files = named or changed_files()
    near = tests_near(files, Imports())
    sys.stdout.write(f"{len(files)} changed files, {len(near)} test files cover them\n")
    sys.stdout.flush()
    if not near:
        return 0
    paths = [ROOT / path for path in near]
    arguments = ["-q", "-n", "0", *options, *map(str, paths)]
    clock = time.process_time if PROCESSOR in sys.argv else time.monotonic
    return int(pytest.main(arguments, [ForAMinute(paths, SECONDS, clock)]))


if __name__ == "__main__":
    sys.exit(main())
