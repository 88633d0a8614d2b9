"""A drive file made again from its sidecar, byte for byte."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from haptix.errors import InputError
from haptix.files import read_json, reading
from haptix.finger import Finger
from haptix.population import Population
from haptix.screen import Screen
from haptix.signals.audio import file_hash
from haptix.stimuli.apparatus import Apparatus
from haptix.stimuli.rendering import Rendering, write_drive
from haptix.stimuli.set_plan import SetPlan
from haptix.stimuli.stimulus import stimulus_from
from haptix.stimuli.trials import Trigger


def make_again(sidecar: str | Path, out: str | Path, threads: int = 1) -> Path:
    """Make the drive file that a sidecar describes, and check that it is the same.

    Of the set only the sidecar and ``profiles.json`` are read, and the files of recordings in the
    stimulus. The surfaces are built anew if the cache does not have them.

    Parameters
    ----------
    sidecar : path-like
        JSON of a stimulus, beside the ``profiles.json`` of its set.
    out : path-like
        Drive file to write; nothing may be there.
    threads : int
        Threads; they change no byte.

    Raises
    ------
    FileFormatError
        If a file is missing, or is no sidecar of a set.
    InputError
        If something is there, or the bytes differ: of another version of haptix, say.
    """
    sidecar, out = Path(sidecar), Path(out)
    if out.exists():
        raise InputError(f"{out}: is there already; name another file")
    table = read_json(sidecar)
    profiles = read_json(sidecar.with_name("profiles.json"))
    with reading(sidecar, "the sidecar of a stimulus, of this version"):
        plan, apparatus, trigger = _parts(table, profiles[table["profile_hash"]])
        stimulus = plan.stimuli[0]
        keys = apparatus.surface_keys()
        due, version = str(table["sha256"]), table["haptix"]
    response, _ = apparatus.responses(stimulus)
    rendering = Rendering(stimulus, response, plan.sample_rate_hz)
    write_drive(out, rendering, plan, trigger, threads, lambda share: None)
    if file_hash(out) != due:
        out.unlink()
        why = "its surfaces differ" if keys != table["surface_hash"] else "its samples differ"
        raise InputError(
            f"{sidecar}: cannot be made again by this haptix ({why}; made by {version})"
        )
    return out


def _parts(
    table: dict[str, Any], profiles: dict[str, Any]
) -> tuple[SetPlan, Apparatus, Trigger | None]:
    """Set of one stimulus, what it is rendered through, and its trigger."""
    described = {key: value for key, value in table["stimulus"].items() if key != "name"}
    stimulus = stimulus_from(str(table["name"]), described)
    screen = Screen(**profiles["screen"])
    people = tuple(Finger(**one) for one in profiles["fingers"])
    finger = people[0] if len(people) == 1 else Population(people, str(table["fingers"]))
    plan = SetPlan(
        str(table["set"]), (stimulus,), finger, (screen,), float(table["sample_rate_hz"]),
        table["format"], table["encoding"], float(table["full_scale_v"]),
        float(table["ceiling_v"]), table["trigger"] is not None, "nearest",
    )  # fmt: skip
    ranges = {name: tuple(ends) for name, ends in table["surface_ranges"].items()}
    trigger = None
    if table["trigger"] is not None:
        code, codes = int(table["trigger"]["onset_code"]), table["trigger"].get("onset_codes", [0])
        trigger = Trigger(code, int(table["samples"]), plan.sample_rate_hz, len(codes))
    return plan, Apparatus.over(finger, screen, ranges), trigger
