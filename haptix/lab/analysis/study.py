"""A BIDS study (Brain Imaging Data Structure): its folder, and the export of sessions.

Motion after BIDS-Motion (BEP029; Jeung et al., Sci. Data 11, 716 (2024)). Participants have
pseudonyms alone; dates stay in the log, a copy of which is in ``sourcedata``.
"""

from __future__ import annotations

import csv
import gzip
import hashlib
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import (
    LARGEST_TABLE_BYTES,
    json_text,
    read_bytes,
    read_json,
    read_text,
    reading,
    write_whole,
)
from haptix.base.version import __version__
from haptix.lab.experiment.session_plan import replayed, task_named
from haptix.lab.experiment.trial_log import COLUMNS, SETTINGS, End, TouchLog, read_log

BIDS_VERSION = "1.10.0"
HED_VERSION = "8.3.0"

_HED = {
    "practice": "Sensory-event, Tactile-presentation, Experimental-stimulus, (Label/Practice)",
    "catch": "Sensory-event, Tactile-presentation, Experimental-stimulus, (Label/Catch)",
    "trial": "Sensory-event, Tactile-presentation, Experimental-stimulus, Target",
}
_KINDS = {"practice": "Not counted, with feedback", "catch": "Without a target", "trial": "Counted"}
_ASKS = {
    "2ifc": "Two intervals, one with the target: which one?",
    "2afc": "One stroke, the target on its left or right half: on which one?",
    "3afc": "Three intervals, one with the target: which one?",
    "yes-no": "One interval, with the target or not: was it there?",
    "same-different": "Two intervals, alike or not: were they different?",
    "pairs": "Two stimuli: which one is more?",
    "triads": "Three stimuli: which one is least like the other two?",
    "sorting": "One stimulus: which group of like ones is it in?",
    "magnitude": "One stimulus: how strong is it, as a number?",
}

_LOCK_S = 60.0  # an export takes less than one
_LOGS = ("_log.tsv", "_log_touches.tsv", "_log_end.json")

_README = """# Data of an experiment with haptix

Layout: the Brain Imaging Data Structure. `sourcedata` has the logs as they were written.
Participants are known by their pseudonyms alone.
"""


def begin(study: str | Path, name: str) -> list[Path]:
    """Begin a study: an experiment to change, in ``code``, and its description of itself.

    Raises `InputError` if the folder is there and not empty.
    """
    study = Path(study)
    if study.exists() and (not study.is_dir() or any(study.iterdir())):
        raise InputError(f"{study}: is not empty; name a folder that is not there yet")
    files = _of_study(study, None, name)
    recipe = Path(__file__).with_name("experiment_template.toml").read_bytes()
    files[study / "code" / "experiment.toml"] = recipe
    for path, data in files.items():
        write_whole(path, data)
    return list(files)


def session_log(study: Path, participant: str, session: str, task: str) -> Path:
    """Return where the log of a session lies in a study.

    Raises `InputError` if a label is none, or the study has the participant in another spelling.
    """
    for name, label in (("participant", participant), ("session", session), ("task", task)):
        if not re.fullmatch(r"[A-Za-z0-9]{1,64}", label):
            raise InputError(f"{name}: BIDS labels have letters and digits alone, got {label!r}")
    spelled = _spelling(participant)
    for there in sorted({*study.glob("sub-*"), *study.glob("sourcedata/sub-*")}):
        other = there.name.removeprefix("sub-")
        if other != participant and _spelling(other) == spelled:
            raise InputError(
                f"participant: the study has {other!r}, which could be the same as "
                f"{participant!r}; write it as {other!r}, or give another number"
            )
    place = study / "sourcedata" / f"sub-{participant}" / f"ses-{session}"
    return place / f"sub-{participant}_ses-{session}_task-{task}_log.tsv"


def _spelling(participant: str) -> str:
    """Return one key for 7, 07 and 007, or for p7 and P07."""
    return re.sub(r"0*(\d+)$", r"\1", participant.casefold())


def recipe_beside(log: Path) -> Path:
    """Return where the recipe with which a log began lies."""
    return log.with_name(f"{log.stem.removesuffix('_log')}_experiment.toml")


def keep_recipe(recipe: Path, log: Path) -> None:
    """Keep the recipe beside the log of a session that begins with it."""
    if not log.exists():
        write_whole(recipe_beside(log), read_bytes(recipe))


def write_session(
    files: Mapping[Path, bytes], study: Path, participant: str, task: str, record: Path
) -> list[Path]:
    """Write the files of a session, and missing files about the study.

    Raises `InputError` if a file was changed since it was written, or another process does not stop
    writing.

    Parameters
    ----------
    files : mapping of Path to bytes
        Those of the session.
    study : Path
        Folder; made if it is not there.
    participant, task : str
        Labels.
    record : Path
        Keeps the hashes of the files.
    """
    try:
        study.mkdir(parents=True, exist_ok=True)
        with FileLock(study / ".participants.lock", timeout=_LOCK_S):
            about = _of_study(study, participant, task)
            _write(files, study, record)
            for path, data in about.items():
                write_whole(path, data)
    except Timeout:
        raise InputError(f"{study}: another session is being written there; try again") from None
    except OSError as error:
        raise InputError(f"cannot write to {study}: {error.strerror or error}") from None
    return [*about, *files, record]


def _write(files: Mapping[Path, bytes], study: Path, record: Path) -> None:
    """Write the files of a session, and keep their hashes; a file changed since is refused.

    While they are written, `record` has the old hashes and the new ones, so that an export that was
    stopped can be done again.
    """
    known: dict[str, list[str]] = read_json(record) if record.exists() else {}
    new = {path.relative_to(study).as_posix(): _sha256(data) for path, data in files.items()}
    for name, digest in new.items():
        path = study / name
        if name.endswith(_LOGS) or not path.exists():
            continue
        if _sha256(read_bytes(path, LARGEST_TABLE_BYTES)) not in {*known.get(name, ()), digest}:
            raise InputError(
                f"{path}: was changed since it was exported, and stays as it is; move it away to "
                "have it written anew"
            )
    write_whole(record, json_text({name: [*known.get(name, ()), new[name]] for name in new}))
    for path, data in files.items():
        write_whole(path, data)
    write_whole(record, json_text({name: [digest] for name, digest in new.items()}))


def _of_study(study: Path, participant: str | None, name: str) -> dict[Path, bytes]:
    """Files about the study that are not there yet, and its participants."""
    about = {
        "Name": name,
        "BIDSVersion": BIDS_VERSION,
        "HEDVersion": HED_VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{"Name": "haptix", "Version": __version__}],
    }
    files = {
        study / "dataset_description.json": json_text(about).encode(),
        study / "README.md": _README.encode(),
        study / "participants.json": json_text(
            {"participant_id": {"Description": "Pseudonym of the participant"}}
        ).encode(),
    }
    files = {path: data for path, data in files.items() if not path.exists()}
    table = study / "participants.tsv"
    text = read_text(table) if table.exists() else "participant_id\n"
    if participant is None:
        return files
    names, *lines = text.splitlines()
    if names.split("\t")[0] != "participant_id":
        raise FileFormatError(f"{table}: expected participant_id as its first column")
    label = f"sub-{participant}"
    if label not in (line.split("\t")[0] for line in lines):
        row = "\t".join([label, *["n/a"] * names.count("\t")])
        files[table] = ("\n".join([names, *lines, row]) + "\n").encode()
    return files


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


RATE_HZ = 100.0
"""Of force and stimulus, which BIDS wants at regular times; panels report at 60 to 240 Hz."""

_ABOUT = "A finger slides over an electrovibration touchscreen"
_GAP_S = 0.1  # between two reports of one touch
MOST_SAMPLES = 10_000_000  # of a stimulus that is sampled faster than at `RATE_HZ`
_NOT_TRACKED = ("ACCEL", "ANGACCEL", "GYRO", "JNTANG", "MAGN", "MISC", "ORNT", "VEL")
_LEFT_OUT = ("date", "right", "before")

_TEXTS = {
    "trial": "Number of the trial; rejected attempts have that of the trial that followed",
    "attempt": "Earlier attempts at this trial",
    "time_s": "Time of the answer since the session began [s]",
    "level_asked": "Level that the method asked for",
    "level": "Level that was presented, if there was a target; of items their number, from 0",
    "lowered_to_ceiling": "Whether the ceiling of the voltage lowered the level",
    "correct": "Answer that was right",
    "answer": "Answer that was given",
    "is_right": "Whether they are the same",
    "normal_force_n": "Mean normal force of the finger [N]",
    "speed_mm_per_s": "Mean speed of the finger [mm/s]",
    "accepted": "Whether the touch was as asked, so that the trial counts",
    "why": "Why it does not count, or counts though it was out of range",
    "session": "Times that the session was resumed, and one",
    "reaction_s": "Time from the end of the presentation to the answer [s]",
    "version": "Program that wrote the row",
    "device": "Device that played",
    "profile": "Finger and screen, and a hash of their profiles",
    "kind": "practice, catch or (counted) trial",
    "condition": "Condition of the experiment",
    "source": "Where the answer came from: terminal, page, simulated, imported or program",
    "other_level": "Level that it was compared with, of a triad two; n/a for the reference",
    "onset_s": "Begin of the first interval since the session began",
    "duration_s": "Length of the presentation, with its pauses",
    "onset": "Begin of the first interval since the recording began",
    "duration": "Length of the presentation, with its pauses",
    "response_time": "Time from the end of the presentation to the answer",
    "trial_type": "practice, catch or (counted) trial",
}


def export(
    log: str | Path,
    study: str | Path,
    participant: str,
    session: str,
    task: str,
    recipe: str | Path | None = None,
) -> list[Path]:
    """Write a log, and the touches beside it, into the folder of a study; return the files.

    Files of other participants and sessions stay as they are, as does its description
    and of its participants. A session that is exported again is written anew, where its log goes on
    and nobody has changed its files; otherwise they stay, and it is refused. Raises `InputError` if
    a label is none, the log was run as another participant or is in the study under other labels,
    or the session is there with other trials or changed files; `FileFormatError` if the log is
    none, was changed, or has other trials than its plan, or a file cannot be written.

    Parameters
    ----------
    log : path
        Log of `Experiment`.
    study : path
        Folder of the data set; made if it is not there.
    participant, session, task : str
        Labels: letters and digits. The participant's is a pseudonym.
    recipe : path, optional
        That of the log, kept beside its copy; by default the one that lies beside the log.
    """
    log, study = Path(log), Path(study)
    copy = session_log(study, participant, session, task)
    logged = read_log(log)
    ran = str(logged.settings.get("participant", participant))
    if _spelling(ran) != _spelling(participant):
        raise InputError(
            f"participant: {log} was run as participant {ran!r}, got {participant!r}; give that "
            "one, or the log that you mean"
        )
    begin = _begin(log)
    for other in sorted(study.glob("sourcedata/sub-*/**/*_log.tsv")):
        if logged.rows and other.name != copy.name and _begin(other) == begin:
            raise InputError(
                f"{log}: the study has it as {other.name}; give those labels, or move that session "
                "away"
            )
    replayed(logged)
    rows = logged.rows
    touches = TouchLog(log)
    kept = {(row["session"], row["trial"], row["attempt"]) for row in rows}
    samples = [
        touch
        for touch in touches.rows()
        if (touch["session"], touch["trial"], touch["attempt"]) in kept
    ]
    base = copy.name.removesuffix("_log.tsv")
    place = study / f"sub-{participant}" / f"ses-{session}"
    files = _beh(place / "beh" / base, rows, task, logged.settings)
    if samples:
        files |= _motion(place / "motion" / base, samples, rows, task, logged.settings)
        files |= _force(place / "beh" / base, samples, task)
    for path, to in ((log, copy), (touches.path, TouchLog(copy).path)):
        if path.exists() and not (to.exists() and to.samefile(path)):
            files[to] = _grown(path, to)
    kept_recipe, copied_recipe = Path(recipe or recipe_beside(log)), recipe_beside(copy)
    if copy in files and (recipe or kept_recipe.exists()):
        files[copied_recipe] = read_bytes(kept_recipe)
    end = End.place(log)
    if copy in files and end.exists():
        files[End.place(copy)] = read_bytes(end)
    return write_session(files, study, participant, task, copy.with_name(f"{base}_files.json"))


def _begin(log: Path) -> list[bytes]:
    """Return the head of a log and its first row, whose date no other has."""
    with reading(log, "a log"), log.open("rb") as file:
        return [file.readline() for _ in range(3)]


def _grown(path: Path, copy: Path) -> bytes:
    """Return a log's bytes; refuse to replace one that it does not continue."""
    data = read_bytes(path, LARGEST_TABLE_BYTES)
    if copy.exists() and not data.startswith(read_bytes(copy, LARGEST_TABLE_BYTES)):
        raise InputError(
            f"{copy}: has other trials than {path}, and stays as it is; give another participant, "
            "session or task, or move it away"
        )
    return data


def _beh(
    base: Path, rows: Sequence[Mapping[str, str]], task: str, settings: Mapping[str, Any]
) -> dict[Path, bytes]:
    """Behaviour of every attempt, and the stimulus against time."""
    names = [name for name in COLUMNS if name not in _LEFT_OUT]
    table = [
        {
            "duration_s": _duration(row),
            "correct": row["right"],
            **{name: row[name] for name in names},
        }
        for row in rows
    ]
    # Not "onset" and "duration", by which a table would be one of events.
    names = ["duration_s", "correct", *names]
    columns: dict[str, Any] = {name: {"Description": _TEXTS[name]} for name in names}
    columns["onset_s"]["Units"] = columns["duration_s"]["Units"] = "s"
    columns["kind"] |= {"Levels": _KINDS, "HED": _HED}
    about = {"TaskName": task, **_described(settings), SETTINGS: settings, **columns}
    files = {
        base.with_name(f"{base.name}_beh.tsv"): _tsv(names, table),
        base.with_name(f"{base.name}_beh.json"): json_text(about).encode(),
    }
    timed = [row for row in rows if row["onset_s"] != "n/a"]
    return files | (_stimulus(base, timed, task, settings) if timed else {})


def _described(settings: Mapping[str, Any]) -> dict[str, str]:
    asks = _ASKS.get(str(settings.get("task")))
    return {} if asks is None else {"TaskDescription": _ABOUT, "Instructions": asks}


def _stimulus(
    base: Path, rows: Sequence[Mapping[str, str]], task: str, settings: Mapping[str, Any]
) -> dict[Path, bytes]:
    """Return the level at regular times, close enough that no trial falls between two."""
    onset_s = np.array([float(row["onset_s"]) for row in rows])
    start, end = onset_s.min(), max(float(row["time_s"]) for row in rows)
    closest_s = np.diff(np.unique(onset_s)).min(initial=1 / RATE_HZ)
    # Rounded: 1 / 0.004 must not become 251.
    needed_hz = np.ceil(round(1 / closest_s, 6))
    rate_hz = max(RATE_HZ, min(needed_hz, MOST_SAMPLES / max(end - start, 1 / RATE_HZ)))
    # Half up: Python's `round` takes 1.5 and 2.5 to the same sample.
    first = np.floor((onset_s - start) * rate_hz + 0.5).astype(int)
    level = np.full(max(round((end - start) * rate_hz), first.max()) + 1, np.nan)
    asked = task_named(settings["task"])
    for at, row in zip(first, rows, strict=True):
        if not (asked.detects and row["kind"] == "catch"):
            level[at : at + max(1, round(float(_duration(row)) * rate_hz))] = float(row["level"])
    items = settings["method"].get("items")
    what = f"Number, from 0, of the item ({', '.join(items)})" if items else "Level of the target"
    if asked.is_ordered:
        what = f"{what.replace('target', 'stimulus')} that is presented first"
    text = f"{what} while a trial is presented, its pauses included"
    if asked.detects:
        text += "; n/a in trials without one"
    if lost := len(rows) - len(np.unique(first)):
        text += (
            f"; without {lost} trials that began less than a sample before another: "
            "*_beh.tsv has the onset and level of every trial"
        )
    unit = "" if items else "dB"
    return _continuous(base, task, "stim", level, start, "level", text, unit, rate_hz)


def _duration(row: Mapping[str, str]) -> str:
    cells = [row[name] for name in ("time_s", "reaction_s", "onset_s")]
    if "n/a" in cells:
        return "n/a"
    answered, reaction, onset = map(float, cells)
    return f"{max(0.0, answered - reaction - onset):.4f}"


def _motion(
    base: Path,
    samples: Sequence[Mapping[str, str]],
    rows: Sequence[Mapping[str, str]],
    task: str,
    settings: Mapping[str, Any],
) -> dict[Path, bytes]:
    """Path of the finger as the panel reported it, with the time of each report."""
    # Reports come in their order; what is known of the driver's clock gets better meanwhile.
    t_s = np.maximum.accumulate([float(sample["t_s"]) for sample in samples])
    steps = np.diff(t_s)
    steps = steps[(steps > 0) & (steps < _GAP_S)]
    rate = float(1 / np.median(steps)) if len(steps) else RATE_HZ
    name = f"{base.name}_tracksys-panel"
    start = float(t_s[0])
    table = io.StringIO()
    for at, sample in zip(t_s, samples, strict=True):
        table.write(f"{sample['x_mm']}\t{sample['y_mm']}\t{at - start:.5f}\n")
    channels = [
        {"name": axis, "component": axis, "type": "POS", "tracked_point": "finger", "units": "mm"}
        for axis in ("x", "y")
    ]
    channels.append({"name": "latency", "component": "n/a", "type": "LATENCY",
                     "tracked_point": "n/a", "units": "s"})  # fmt: skip
    about = {
        "TaskName": task,
        **_described(settings),
        "DeviceSerialNumber": rows[0]["device"],
        "MissingValues": "n/a",
        "SamplingFrequency": round(rate, 3),
        "SamplingFrequencyEffective": round(rate, 3),
        "TrackingSystemName": "panel",
        "MotionChannelCount": 3,
        "POSChannelCount": 2,
        "LATENCYChannelCount": 1,
        **{f"{kind}ChannelCount": 0 for kind in _NOT_TRACKED},
        "TrackedPointsCount": 1,
    }
    events = [
        {
            "onset": f"{float(row['onset_s']) - start:.4f}",
            "duration": _duration(row),
            "trial_type": row["kind"],
            "response_time": row["reaction_s"],
        }
        for row in rows
        if row["onset_s"] != "n/a"
    ]
    names = ["onset", "duration", "trial_type", "response_time"]
    described: dict[str, Any] = {key: {"Description": _TEXTS[key]} for key in names}
    for key in ("onset", "duration", "response_time"):
        described[key]["Units"] = "s"
    described["trial_type"] |= {"Levels": _KINDS, "HED": _HED}
    described["StimulusPresentation"] = {"SoftwareName": "haptix", "SoftwareVersion": __version__}
    return {
        base.with_name(f"{name}_motion.tsv"): table.getvalue().encode(),
        base.with_name(f"{name}_motion.json"): json_text(about).encode(),
        base.with_name(f"{name}_channels.tsv"): _tsv(list(channels[0]), channels),
        base.with_name(f"{base.name}_events.tsv"): _tsv(names, events),
        base.with_name(f"{base.name}_events.json"): json_text(described).encode(),
    }


def _force(base: Path, samples: Sequence[Mapping[str, str]], task: str) -> dict[Path, bytes]:
    """Normal force at regular times, between reports and at each; n/a elsewhere."""
    known = [sample for sample in samples if sample["normal_force_n"] != "n/a"]
    if not known:
        return {}
    t_s, first = np.unique([float(sample["t_s"]) for sample in known], return_index=True)
    force = np.array([float(known[k]["normal_force_n"]) for k in first])
    start = float(t_s[0])
    at = start + np.arange(round((t_s[-1] - start) * RATE_HZ) + 1) / RATE_HZ
    force_n = np.interp(at, t_s, force)
    after = np.searchsorted(t_s, at).clip(1, max(1, len(t_s) - 1))
    if len(t_s) > 1:
        force_n[t_s[after] - t_s[after - 1] > _GAP_S] = np.nan
    nearest = np.rint((t_s - start) * RATE_HZ).astype(int)
    is_alone = np.isnan(force_n[nearest])
    force_n[nearest[is_alone]] = force[is_alone]
    return _continuous(base, task, "physio", force_n, start, "normal_force", "Normal force", "N")


def _continuous(
    base: Path,
    task: str,
    suffix: str,
    values: np.ndarray[Any, np.dtype[np.float64]],
    start_s: float,
    column: str,
    text: str,
    unit: str,
    rate_hz: float = RATE_HZ,
) -> dict[Path, bytes]:
    """Table of a recording at regular times: compressed, without names of columns."""
    cells = ("n/a" if np.isnan(value) else f"{value:.6g}" for value in values)
    about = {
        "TaskName": task,
        "SamplingFrequency": float(rate_hz),
        "StartTime": round(start_s, 5),
        "Columns": [column],
        column: {"Description": text, **({"Units": unit} if unit else {})},
        **({"PhysioType": "generic"} if suffix == "physio" else {}),
    }
    data = gzip.compress(("\n".join(cells) + "\n").encode(), mtime=0)
    return {
        base.with_name(f"{base.name}_{suffix}.tsv.gz"): data,
        base.with_name(f"{base.name}_{suffix}.json"): json_text(about).encode(),
    }


def _tsv(names: Sequence[str], rows: Iterable[Mapping[str, object]]) -> bytes:
    text = io.StringIO()
    table = csv.DictWriter(text, names, delimiter="\t", lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue().encode()
