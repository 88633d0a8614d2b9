"""The reference: every public name is described, its parameters too, and many have an example."""

import ast
import inspect
import re
import sys
from enum import Enum
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from types import FunctionType

import haptix

ROOT = Path(haptix.__file__).parents[1]
sys.path.insert(0, str(ROOT / "scripts"))
site_pages = import_module("site_pages")

ENTRY = re.compile(r"^(\*{0,2}\w+(?:, \*{0,2}\w+)*)(?: :.*)?$", re.M)


def is_ours(found):
    return found.__module__.partition(".")[0] in {"haptix", "firmware_io", "calibration"}


@cache
def public():
    """Each public function, class, method and property by the first name that the pages give it."""
    found, known = {}, set()

    def take(name, thing, owner=None):
        if id(thing) not in known:
            known.add(id(thing))
            found[name] = (thing, owner)

    for package in site_pages.PACKAGES:
        for name in site_pages.public_names(package):
            thing = getattr(import_module(package), name)
            if isinstance(thing, type) and is_ours(thing):
                take(f"{package}.{name}", thing)
                for base in filter(is_ours, thing.__mro__):
                    for part, value in list(vars(base).items()):
                        value = getattr(value, "__func__", value)
                        if part in vars(base).get("__annotations__", ()):
                            continue  # a field: its class describes it
                        if part[0] != "_" and isinstance(
                            value, FunctionType | property | cached_property
                        ):
                            take(f"{package}.{name}.{part}", value, base)
            elif isinstance(thing, FunctionType):
                take(f"{package}.{name}", thing)
    return found


def named_in(text):
    """Parameters and attributes that a docstring lists."""
    names = set()
    for section in re.split(r"\n(?=\w[\w ]*\n-{3,}\n)", inspect.cleandoc(text or "")):
        if re.match(r"(Other Parameters|Parameters|Attributes)\n-", section):
            for entry in ENTRY.findall(section):
                names |= {name.strip(" *") for name in entry.split(",")}
    return names


@cache
def classes_of(file):
    """The definitions of a module's classes, by their names."""
    tree = ast.parse(Path(file).read_text(encoding="utf-8"))
    return {node.name: node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


def fields_with_text(kind):
    """Fields that have a text below them; those just above share it."""
    names, above = set(), []
    for base in filter(is_ours, kind.__mro__):
        for statement in classes_of(inspect.getfile(base))[base.__name__].body:
            match statement:
                case ast.AnnAssign(target=ast.Name(name)):
                    above.append(name)
                case ast.Expr(ast.Constant(str())):
                    names |= set(above)
                    above = []
                case _:
                    above = []
    return names


def parameters(thing):
    if isinstance(thing, property | cached_property):
        return []
    if isinstance(thing, type) and (
        issubclass(thing, Enum | Exception) or getattr(thing, "_is_protocol", False)
    ):
        return []  # nobody makes one
    kinds = inspect.signature(thing).parameters
    constant = {"kind", "schema_version", "format"} if isinstance(thing, type) else set()
    return [n for n in kinds if n not in {"self", "cls", "values", *constant} and n[0] != "_"]


def without_text(thing, owner):
    """Parameters that no docstring explains: of the thing, or of what it overrides."""
    names = parameters(thing)
    if len(names) < 2:
        return []
    told = named_in(thing.__doc__)
    if isinstance(thing, type):
        told |= fields_with_text(thing)
        for base in filter(is_ours, thing.__mro__):
            told |= named_in(base.__doc__)
            told |= named_in(getattr(vars(base).get("__init__"), "__doc__", ""))
    elif owner is not None:
        for base in filter(is_ours, owner.__mro__):
            told |= named_in(getattr(vars(base).get(thing.__name__), "__doc__", ""))
    return [name for name in names if name not in told]


def test_every_public_name_is_described():
    assert len(public()) > 900
    assert not [name for name, (thing, _) in public().items() if not inspect.getdoc(thing)]


def test_parameters_are_described_where_there_are_two_or_more():
    found = {name: without_text(*one) for name, one in public().items()}
    assert not {name: missing for name, missing in found.items() if missing}


def test_many_public_names_have_an_example():
    with_example = [
        name for name, (thing, _) in public().items() if ">>> " in (thing.__doc__ or "")
    ]
    assert len(with_example) >= 150
