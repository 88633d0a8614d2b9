"""Make small errors in the packages, and count those that the tests find: `make mutants`.

    .venv/bin/python scripts/mutants.py                                   # 300 of all packages
    .venv/bin/python scripts/mutants.py --count 40 haptix/play/render     # 40 of a folder

An error is another comparison, operator or number, or a call or a `raise` that is left out. Each is
made in a copy of the repository, where the tests nearest to it run as `make quick` runs them, for a
minute of the processor, up to the first that fails. The choice follows from the seed and the text
of each line, so that it stays the same while other lines change. What no test finds is listed.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGES = ("haptix", "firmware_io", "calibration")
OPTIONS = ("--processor-time", "-x", "-p", "no:cacheprovider")
LONGEST_S = 900.0  # a mutant that hangs longer than that is found
NOT_COPIED = shutil.ignore_patterns(
    ".git", ".venv", "__pycache__", "node_modules", "dist", "site", ".*_cache", ".hypothesis"
)
OPERATORS: dict[type[ast.AST], Any] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Pow: ast.Mult,
    ast.And: ast.Or,
    ast.Or: ast.And,
}


@dataclass(frozen=True)
class Mutant:
    """One error: `after` in place of `before` in a line of a file."""

    file: Path
    line: int
    column: int
    start: int  # bytes from the start of the file
    before: str
    after: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.before!r} -> {self.after!r}"


def changed(node: ast.AST) -> str | None:
    """Return the wrong text of a node, or None for one that stays."""
    match node:
        case ast.Compare(left, [operator], [right]) if type(operator) in OPERATORS:
            return ast.unparse(ast.Compare(left, [OPERATORS[type(operator)]()], [right]))
        case ast.BinOp(left, operator, right) if type(operator) in OPERATORS:
            return f"({ast.unparse(ast.BinOp(left, OPERATORS[type(operator)](), right))})"
        case ast.BoolOp(operator, values):
            return f"({ast.unparse(ast.BoolOp(OPERATORS[type(operator)](), values))})"
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            return f"({ast.unparse(operand)})"
        case ast.Constant(bool() as value):
            return str(not value)
        case ast.Constant(int() as value):
            return str(value + 1)
        case ast.Constant(float() as value):
            return repr(2 * value or 1.0)
        case ast.Raise() | ast.Expr(ast.Call()):
            return None if "log" in ast.unparse(node).partition("(")[0] else "pass"
    return None


def nodes_of(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield what runs: no annotation, decorator, text or block for type checkers."""
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for node in value if isinstance(value, list) else [value]:
            if not isinstance(node, ast.AST) or isinstance(node, ast.JoinedStr):
                continue
            if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
                continue
            yield node
            yield from nodes_of(node)


def mutants_of(file: Path) -> Iterator[Mutant]:
    """Yield all errors that can be made in a file."""
    source = (ROOT / file).read_bytes()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node in nodes_of(ast.parse(source)):
        after = changed(node)
        if after is not None and isinstance(node, ast.expr | ast.stmt):
            assert node.end_lineno is not None and node.end_col_offset is not None
            start = starts[node.lineno - 1] + node.col_offset
            end = starts[node.end_lineno - 1] + node.end_col_offset
            yield Mutant(
                file, node.lineno, node.col_offset, start, source[start:end].decode(), after
            )


def chosen(folders: list[str], count: int, seed: int) -> list[Mutant]:
    """Return as many mutants as asked for, of all that can be made."""
    by_order = []
    for folder in folders:
        at = ROOT / folder
        for path in sorted(at.rglob("*.py")) if at.is_dir() else [at]:
            lines = path.read_text("utf-8").split("\n")
            for one in mutants_of(path.relative_to(ROOT)):
                line = f"{path.name} {lines[one.line - 1].strip()} {one.column}"
                text = f"{seed} {line} {one.before} {one.after}"
                by_order.append((hashlib.sha256(text.encode()).hexdigest(), str(one), one))
    return [one for *_, one in sorted(by_order, key=lambda row: row[:2])[:count]]


def is_found(mutant: Mutant, copy: Path) -> bool:
    """Run the nearest tests on a mutant in a copy; whether one failed."""
    target = copy / mutant.file
    source = target.read_bytes()
    end = mutant.start + len(mutant.before.encode())
    target.write_bytes(source[: mutant.start] + mutant.after.encode() + source[end:])
    tests = subprocess.Popen(
        [sys.executable, "scripts/quick.py", str(mutant.file), *OPTIONS],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        return tests.wait(LONGEST_S) != 0
    except subprocess.TimeoutExpired:
        os.killpg(tests.pid, signal.SIGKILL)  # with the processes that its tests began
        tests.wait()
        return True
    finally:
        target.write_bytes(source)


def main() -> None:
    """Choose, try, count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", default=PACKAGES, help="folders or files")
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    asked = parser.parse_args()
    mutants = chosen(list(asked.folders), asked.count, asked.seed)
    copies: queue.Queue[Path] = queue.Queue()

    def attempt(mutant: Mutant) -> bool:
        copy = copies.get()
        try:
            return is_found(mutant, copy)
        finally:
            copies.put(copy)

    with tempfile.TemporaryDirectory() as folder:
        for number in range(asked.processes):
            copies.put(shutil.copytree(ROOT, Path(folder) / str(number), ignore=NOT_COPIED))
        with ThreadPoolExecutor(asked.processes) as pool:
            found = 0
            for mutant, was in zip(mutants, pool.map(attempt, mutants), strict=True):
                found += was
                if not was:
                    sys.stdout.write(f"not found: {mutant}\n")
                    sys.stdout.flush()
    sys.stdout.write(f"{found} of {len(mutants)} found\n")


if __name__ == "__main__":
    main()
