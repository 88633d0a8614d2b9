"""The folder of a study in the form of BIDS: where sessions lie, and that nothing is replaced."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path

from filelock import FileLock, Timeout

from haptix.errors import FileFormatError, InputError
from haptix.files import (
    LARGEST_TABLE_BYTES,
    json_text,
    read_bytes,
    read_json,
    read_text,
    write_whole,
)
from haptix.version import __version__

BIDS_VERSION = "1.10.0"
_LOCK_S = 60.0  # an export takes less than one
_LOGS = ("_log.tsv", "_log_touches.tsv")
_README = """# Data of an experiment with haptix

Layout: the Brain Imaging Data Structure. `sourcedata` has the logs as they were written.
Participants are known by their pseudonyms alone.
"""


def begin(study: str | Path, name: str) -> list[Path]:
    """Begin a study: an experiment to change, in ``code``, and what the study says of itself.

    Raises
    ------
    InputError
        If the folder is there and not empty.
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

    Raises
    ------
    InputError
        If a label is none.
    """
    for name, label in (("participant", participant), ("session", session), ("task", task)):
        if not re.fullmatch(r"[A-Za-z0-9]{1,64}", label):
            raise InputError(f"{name}: BIDS labels have letters and digits alone, got {label!r}")
    place = study / "sourcedata" / f"sub-{participant}" / f"ses-{session}"
    return place / f"sub-{participant}_ses-{session}_task-{task}_log.tsv"


def keep_recipe(recipe: Path, log: Path) -> None:
    """Keep the recipe beside the log of a session that begins with it."""
    if not log.exists():
        copy = log.with_name(log.name.replace("_log.tsv", "_experiment.toml"))
        write_whole(copy, read_bytes(recipe))


def write_session(
    files: Mapping[Path, bytes], study: Path, participant: str, task: str, record: Path
) -> list[Path]:
    """Write the files of a session, and what the study does not say yet of itself.

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

    Raises
    ------
    InputError
        If a file was changed since it was written, or another process does not stop writing.
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
    """Write the files of a session, and keep their hashes; what was changed since is refused.

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
