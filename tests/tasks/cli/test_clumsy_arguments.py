"""What people type by mistake, tried on every parameter that the command line defines."""

import sys

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from typer.main import get_command

from haptix.tasks.cli.application import app
from tests.command_line import run_haptix

LONG = "a" * 5000
# Every parameter of the command line has one kind; each kind, what cannot be one of it. In the
# folder there are a file called "file" and a folder called "folder".
NOT_READ = ("", "missing", "folder", LONG, "file/below", "fehlt-\u00fc\U0001f600", "a\nb")
NOT_WRITTEN = ("folder", LONG, "file/below", "folder/", ".", "..", "file/a/b")
NOT_THERE = ("missing", LONG, "file/below")
NOT_MADE = ("file", "file/below", LONG)
NOT_A_NUMBER = ("", "nan", "inf", "-inf", "1e309", "ten", "1,5", "0x10", "1 K", "--", "\u00bd")
KINDS = {
    "file that is read": (
        "--image --material --trajectory --profile --tap --inputs --columns --plan --certificate "
        "--key --recipe --instruments --before --after --dielectric --preregistration --about "
        "measurements scene plan recipe sidecar log file "
        "files profile a b recording one other layout",
        NOT_READ,
    ),
    "surface that is read": ("--surface surface", NOT_READ),
    "file or folder that is read": ("--csv what source sources sessions", NOT_THERE),
    "file that is written": ("--out --log --page --preregister out", NOT_WRITTEN),
    "file that may be new": ("--register-file register_file", ("folder", LONG, "file/below")),
    "folder": ("--root --study study folder", NOT_MADE),
    "preset": (
        "--finger --screen --slider --touched-by",
        ("", "missing", "semiwet", "Semi-wet", "missing.toml", LONG, ".toml", "folder/.toml"),
    ),
    "word": (
        "shell --skin-dielectric --fidelity --theory --with --without --polarity --waveform "
        "--protocol --source --on --convention --remove --beyond",
        ("", "missing", "mean_field", "FINITE-SIZE", LONG, "\u00fc"),
    ),
    "address": (
        "--device --proof-test",
        ("", "usb", "ubs:", "mock:colour=red", "mock:pace=fast", "mock:pace", "mock:lead_s=nan",
         "mock:pace=real,pace=real", "COM3", "tcp:", "tcp:host", LONG),
    ),
    "number": (
        "--width-mm --height-mm --inset-mm "
        "--carrier-hz --direct-hz --touch-hz --touch-latency-ms --reaction-ms "
        "--horizon-ms --largest-mb --memory-gb --simulate-db --difference-db --between-db "
        "--max-voltage-v --minutes --crosstalk --temperature-c --humidity-percent --weight-n "
        "--repeatability-percent --tolerance-jnd --normal-reading-n --tangential-reading-n "
        "--speed-mm-per-s --shortest-mm --longest-mm --ask-after-h --second-weight-n "
        "--second-tangential-reading-n --seconds --h-rms-m --pixel-m --hurst --longest-m "
        "--area-m2 --thickness-m --full-scale-v",
        NOT_A_NUMBER,
    ),
    "numbers": (
        "--normal-force-n --voltage-v --frequency-hz --h0-m --mu --mu-range --tolerance "
        "--monitor-v --monitor-hz --voltmeter-rms-v --threshold-db --slope --lapse --participants",
        ("", ",", "nan", "inf", "1e309", "ten", "1,,2", "1;2", "1 K", "\u00bd", "[1]"),
    ),
    "whole number": (
        "--port --processes --first --threads --workers --runs --levels --seed",
        ("", "-1", "1.5", "1e3", "ten", "nan", "9" * 40, "9" * 5000),
    ),
    "pair": ("--fix --prior", ("", "=", "h0_m", "h0_m=", "h0_m=nan", "h0_m=1,2,3", "=1,2")),
    "label": ("--participant --session --task", ("", "a b", "\u00e4", "../x", "a" * 65)),
    "name": ("--name --panel --serial --listen", ("", " ")),
    "board": ("board", ("", "uno", "Pico")),
    "any text": ("--operator --unit touchscreen", ()),
}  # fmt: skip
OUT_IS_A_FOLDER = {
    "demo", "render", "tradeoff", "campaign", "stimuli make", "stimuli analyse",
}  # fmt: skip
WRONG = {name: values for names, values in KINDS.values() for name in names.split()}


def commands(group, before=()):
    """Words and definition of every command."""
    for name in group.list_commands(None):
        found = group.get_command(None, name)
        if hasattr(found, "list_commands"):
            yield from commands(found, (*before, name))
        else:
            yield " ".join((*before, name)), found


DEFINITION = get_command(app)
COMMANDS = dict(commands(DEFINITION))
PARAMETERS = [
    (words, one.opts[0])
    for words, command in COMMANDS.items()
    for one in command.params
    if not getattr(one, "is_flag", False)
]


@pytest.fixture
def typed(own_folder, monkeypatch):
    """Type one option in a folder with a file and a folder; a command that would begin exits 99."""
    (own_folder / "file").write_text("x")
    (own_folder / "folder").mkdir()
    monkeypatch.setattr("haptix.tasks.cli.application.app", DEFINITION)
    monkeypatch.setitem(sys.modules, "torch", None)  # importing it would be an error
    for command in COMMANDS.values():
        monkeypatch.setattr(command, "callback", lambda *args, **kwargs: sys.exit(99))

    def run(words, option, value):
        if option.startswith("-"):
            return run_haptix(*words.split(), option, value)
        places = [one.opts[0] for one in COMMANDS[words].params if not one.opts[0].startswith("-")]
        before = ["file"] * places.index(option)
        return run_haptix(*words.split(), "--", *before, value)  # a value may begin with a dash

    return run


def wrong_values(words, option):
    if (option == "--out" and words in OUT_IS_A_FOLDER) or (words, option) == ("compile", "--page"):
        return NOT_MADE
    if (words, option) == ("calibrate install", "--finger"):
        return NOT_READ
    if (words, option) == ("calibrate instruments", "--session"):
        return NOT_THERE
    if (words, option) == ("build", "what"):
        return (*NOT_WRITTEN, "missing.toml")
    if (words, option) == ("calibrate fit", "--finger"):
        return NOT_READ
    return WRONG[option]


def test_every_parameter_has_a_kind():
    assert {option for _, option in PARAMETERS} == set(WRONG)


def the_sentence(shown):
    """What a refusal says; of a parameter that is missing it says nothing of this one."""
    (sentence,) = (
        line for line in shown.err.splitlines() if line.startswith(("haptix: ", "Error: "))
    )
    return "" if sentence.startswith("Error: Missing ") else sentence


def test_what_cannot_be_right_is_refused_in_a_sentence_that_names_the_option(typed):
    wrong, tried = [], 0
    for words, option in PARAMETERS:
        for value in wrong_values(words, option):
            shown = typed(words, option, value)
            if shown.code == 99:
                wrong.append((words, option, value[:20]))
                continue
            tried += 1
            name = option if option.startswith("-") else option.upper()
            sentence = the_sentence(shown).replace("OUT|SCENE.toml", "WHAT")
            if (shown.code, shown.out) != (2, "") or name not in sentence:
                wrong.append((words, option, value[:20], shown.code, shown.err[-200:]))
    assert not wrong, "\n".join(map(repr, wrong))
    assert tried > 800


TYPED = st.one_of(
    st.text(max_size=30),
    st.floats().map(str),
    st.integers().map(str),
    st.lists(st.floats(), max_size=4).map(lambda numbers: ",".join(map(str, numbers))),
    st.sampled_from(sorted({value for _, values in KINDS.values() for value in values})),
)


def check_anything(typed, parameter, value):
    shown = typed(*parameter, value)
    assert shown.code in (2, 99)
    if shown.code == 2:
        assert shown.out == ""
        the_sentence(shown)


ANYTHING = given(st.sampled_from(PARAMETERS), TYPED)
SAME_FOLDER = (HealthCheck.function_scoped_fixture,)  # whatever is typed, nothing begins


@settings(max_examples=50, suppress_health_check=SAME_FOLDER)
@ANYTHING
@example(("calibrate match", "--levels"), "1" * 400)  # more than a float can hold
@example(("material show", "file"), "gallery:\x00")
@example(("plan", "scene"), "a\nb")
def test_whatever_is_typed_is_taken_or_refused_in_a_sentence(typed, parameter, value):
    check_anything(typed, parameter, value)


@pytest.mark.slow
@settings(max_examples=3000, suppress_health_check=SAME_FOLDER)
@ANYTHING
def test_much_more_is_taken_or_refused_in_a_sentence(typed, parameter, value):
    check_anything(typed, parameter, value)
