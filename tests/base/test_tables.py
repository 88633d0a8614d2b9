"""Tables that list what modules define have a row for each, so that nothing is found by chance."""

from importlib import import_module
from pathlib import Path

import pytest

import firmware_io.links
import haptix.feel
from firmware_io.link import scheme_names
from haptix.feel.materials.material import KINDS as MATERIALS
from haptix.feel.materials.material import Material
from haptix.feel.signals.signal import KINDS as SIGNALS
from haptix.feel.signals.signal import Signal


def defined(kind):
    """Kinds of the classes that haptix.feel itself defines."""
    for path in Path(haptix.feel.__file__).parent.rglob("[!_]*.py"):
        parts = path.with_suffix("").parts
        import_module(".".join(parts[parts.index("feel") - 1 :]))
    classes = [kind]
    for one in classes:
        classes += [c for c in one.__subclasses__() if c.__module__.startswith("haptix.")]
    names = {c.model_fields["kind"].default for c in classes if "kind" in c.model_fields}
    return {name for name in names if isinstance(name, str)}


@pytest.mark.parametrize(("kind", "table"), [(Material, MATERIALS), (Signal, SIGNALS)])
def test_every_kind_has_a_row(kind, table):
    assert defined(kind) == set(table._built_in)


def test_every_link_has_a_row():
    folder = Path(firmware_io.links.__file__).parent
    modules = [import_module(f"firmware_io.links.{p.stem}") for p in folder.glob("[!_]*.py")]
    ours = {m.__name__.split(".")[-1] for m in modules if hasattr(m, "SCHEME")}
    assert ours <= set(scheme_names()) and len(ours) == 7
