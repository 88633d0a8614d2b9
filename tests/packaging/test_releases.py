"""One version everywhere; what others read of this project has their schemas' form."""

import json
import re
import tomllib
from importlib.resources import files
from pathlib import Path

import jsonschema
import pytest
from packaging.version import Version
from ruamel.yaml import YAML

import haptix

ROOT = Path(haptix.__file__).parents[1]
ISSUES = ROOT / ".github" / "ISSUE_TEMPLATE"
SCHEMAS = {
    ISSUES / "config.yml": "github-issue-config",
    ISSUES / "defect.yml": "github-issue-forms",
    ISSUES / "wish.yml": "github-issue-forms",
    ROOT / "CITATION.cff": "citation-file-format",
}


def read_yaml(path):
    # As JSON has it: a date is a text.
    read = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    return json.loads(json.dumps(read, default=str))


def schema_of(name):
    folder = files("check_jsonschema") / "builtin_schemas" / "vendor"
    return json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", SCHEMAS, ids=lambda path: path.name)
def test_what_github_reads_has_its_form(path):
    check = jsonschema.validators.validator_for(schema_of(SCHEMAS[path]))(schema_of(SCHEMAS[path]))
    read = read_yaml(path)
    check.validate(read)
    # Without its first key it is something else: the schema sees what it should.
    required = {"citation-file-format": "title"}
    first = required.get(SCHEMAS[path]) or ("body" if "body" in read else None)
    if first:
        with pytest.raises(jsonschema.ValidationError):
            check.validate({key: value for key, value in read.items() if key != first})


def test_the_version_stands_in_one_place():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert "version" in settings["project"]["dynamic"]
    source = (ROOT / settings["tool"]["hatch"]["version"]["path"]).read_text(encoding="utf-8")
    assert f'__version__ = "{haptix.__version__}"' in source
    # What cannot read it there says the same, in the form of its language.
    packages = [
        ROOT / "clients" / name / "package.json" for name in ("typescript", "csharp", "engine")
    ]
    versions = [json.loads(path.read_text())["version"] for path in packages]
    project = (ROOT / "clients" / "csharp" / "Haptix.Client.csproj").read_text()
    versions += re.findall("<Version>(.*)</Version>", project)
    assert {one.replace("-dev.", ".dev") for one in versions} == {haptix.__version__}


def test_the_changelog_and_the_citation_are_of_this_version():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    headings = re.findall(r"^## \[(.+?)\](?: - (\S+))?$", text, re.MULTILINE)
    assert headings[0] == ("Unreleased", "")
    cited = read_yaml(ROOT / "CITATION.cff")
    # Before the first release nothing has a date, and the version is that of the release to come.
    assert headings[1:2] == ([(cited["version"], cited["date-released"])] if headings[1:] else [])
    assert ("date-released" in cited) == bool(headings[1:])


def test_what_is_not_released_is_no_release():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    unreleased = text.partition("## [Unreleased]")[2].partition("\n## [")[0].strip()
    cited = read_yaml(ROOT / "CITATION.cff")
    own, of_release = Version(haptix.__version__), Version(cited["version"])
    assert own.is_devrelease if unreleased else own == of_release
    if "date-released" in cited and unreleased:
        assert own > of_release
    else:
        assert Version(own.base_version) == of_release


def test_what_is_pinned_for_a_release_has_hashes_and_the_versions_of_the_build():
    text = (ROOT / "scripts" / "release-requirements.txt").read_text(encoding="utf-8")
    pins = re.findall(r"^([\w-]+==\S+) \\\n    --hash=sha256:[0-9a-f]{64}", text, re.MULTILINE)
    assert len(pins) == len(re.findall(r"^[\w-]+", text, re.MULTILINE))
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (compiler,) = (
        one for one in settings["project"]["optional-dependencies"]["release"] if "==" in one
    )
    assert compiler in pins
    assert compiler in [one.partition(";")[0] for one in settings["build-system"]["requires"]]
