"""What one system alone has is not imported where a module loads."""

import ast
from pathlib import Path

import pytest

import haptix

ROOT = Path(haptix.__file__).parents[1]
ONE_SYSTEM_HAS = {
    "evdev", "pyudev", "fcntl", "resource", "termios", "tty", "pty", "pwd", "grp", "syslog",
    "msvcrt", "winreg", "_winapi", "winsound",
}  # fmt: skip


def imported_on_loading(source):
    """Modules that are imported as a file loads, unless it tries and goes on without."""
    left = list(ast.parse(source).body)
    while left:
        node = left.pop()
        if isinstance(node, ast.Import):
            yield from (name.name.partition(".")[0] for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield (node.module or "").partition(".")[0]
        elif isinstance(node, ast.With | ast.ClassDef):
            left += node.body
        elif isinstance(node, ast.If) and "sys.platform" not in ast.unparse(node.test):
            left += node.body + node.orelse


@pytest.mark.parametrize("package", ["haptix", "firmware_io", "calibration"])
def test_a_package_loads_on_every_system(package):
    files = list((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        found = ONE_SYSTEM_HAS & set(imported_on_loading(path.read_text(encoding="utf-8")))
        assert not found, path


def test_the_check_sees_what_it_should():
    assert {"fcntl", "pwd", "tty"} <= set(
        imported_on_loading(
            "import fcntl\nif True:\n    from pwd import x\nclass A:\n    import tty"
        )
    )
    guarded = "try:\n    import fcntl\nexcept ImportError:\n    pass\ndef f():\n    import pwd"
    assert not set(imported_on_loading(guarded))
