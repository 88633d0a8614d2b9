"""The recipe for conda asks for what pyproject.toml asks for."""

import tomllib
from pathlib import Path

from ruamel.yaml import YAML

import haptix

ROOT = Path(haptix.__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
RECIPE = YAML(typ="safe").load((ROOT / "recipe" / "recipe.yaml").read_text("utf-8"))
# What conda-forge calls otherwise than PyPI.
NAMES = {"torch": "pytorch", "soundfile": "pysoundfile", "sounddevice": "python-sounddevice"}


def test_the_recipe_has_the_dependencies_of_the_project():
    wanted = {"python": PROJECT["requires-python"]}
    for line in PROJECT["dependencies"]:
        name, lowest = line.split(">=")
        wanted[NAMES.get(name, name)] = f">={lowest}"
    assert dict(line.split() for line in RECIPE["requirements"]["run"]) == wanted


def test_the_recipe_is_of_this_project():
    assert RECIPE["package"]["name"] == PROJECT["name"]
    assert RECIPE["about"]["summary"] == PROJECT["description"]
    assert RECIPE["about"]["license"] == PROJECT["license"]
    released = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text("utf-8"))["version"]
    assert RECIPE["context"]["version"] == released
    commands = [f"{name} = {to}" for name, to in PROJECT["scripts"].items()]
    assert RECIPE["build"]["python"]["entry_points"] == commands
