"""Many solves side by side, each kept in a file as soon as it is done, and their memory."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from haptix.base.errors import FileFormatError, InputError
from haptix.base.executors import Here, finished
from haptix.base.files import reading, write_whole
from haptix.base.threads import one_thread

Row = dict[str, Tensor]
Progress = Callable[[int, int], None]
"""Called with the number of jobs done and of all jobs, after each."""

_FINGERPRINT = "fingerprint"
_LARGEST_BYTES = 1_000_000_000  # of a checkpoint, unpacked; its rows have some kilobytes each

# Doubles per point at the peak: 12 fields of the descent, 6 of transforms and their temporaries,
# and as many again of Anderson's mixing and the gap distribution. At 512 and 1024 points the
# process grew by 22 and by 44 doubles per point.
CONTACT_FIELDS = 24
ATTRACTION_FIELDS = 24


def run_ensemble(
    jobs: int,
    work: Callable[[int], Row],
    fingerprint: str,
    workers: int = 1,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
) -> list[Row]:
    """Do the jobs 0, 1, ... and return their rows; those in the checkpoint are not done again.

    Every job runs on one thread of torch: fields that one thread works on stay in its cache, and
    threads do not wait for each other. Raises `FileFormatError` if the checkpoint cannot be read or
    belongs to another ensemble.

    Parameters
    ----------
    jobs : int
        Number of jobs.
    work : callable
        One job's result, by its number.
    fingerprint : str
        Hash of all that the results depend on; a checkpoint of another one is refused.
    workers : int
        Jobs at a time.
    checkpoint : path, optional
        File (.npz) that keeps finished jobs, replaced as a whole after each.
    progress : Progress, optional
        Called after each job, on the calling thread.
    """
    path = None if checkpoint is None else Path(checkpoint)
    done = {} if path is None else _load(path, fingerprint)
    missing = [job for job in range(jobs) if job not in done]

    def finish(job: int, row: Row) -> None:
        done[job] = row
        if path is not None:
            _save(path, fingerprint, done)
        if progress is not None:
            progress(len(done), jobs)

    workers = min(workers, len(missing))
    with one_thread(), _threads(workers) as pool:
        for job, future in finished(pool, work, missing):
            finish(job, future.result())
    return [done[job] for job in range(jobs)]


def _threads(count: int) -> Executor:
    if count <= 1:
        return Here()
    return ThreadPoolExecutor(count, initializer=torch.set_num_threads, initargs=(1,))


def _load(path: Path, fingerprint: str) -> dict[int, Row]:
    if not path.exists():
        return {}
    done: dict[int, Row] = {}
    with reading(path, "a checkpoint of an ensemble (delete it to start again)"):
        # Of a file that is no archive, numpy would speak of pickles.
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > _LARGEST_BYTES:
            raise ValueError(f"{size} bytes of numbers; expected {_LARGEST_BYTES} at most")
        with np.load(path, allow_pickle=False) as file:
            stored = str(file[_FINGERPRINT])
            for key in file.files:
                if key != _FINGERPRINT:
                    job, _, name = key.partition(" ")
                    done.setdefault(int(job), {})[name] = torch.from_numpy(file[key])
    if stored != fingerprint:
        raise FileFormatError(
            f"{path}: expected the checkpoint of this ensemble, got one of other surfaces, loads "
            "or settings; delete it or name another file"
        )
    return done


def _save(path: Path, fingerprint: str, done: dict[int, Row]) -> None:
    arrays = {f"{job} {name}": v.numpy() for job, row in done.items() for name, v in row.items()}
    arrays[_FINGERPRINT] = np.array(fingerprint)
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays)
    write_whole(path, file.getvalue())


def estimated_bytes(points: int, surfaces: int, coupled: bool = False) -> int:
    """Bytes at the peak for `surfaces` solved at a time on `points` x `points` pixels."""
    fields = CONTACT_FIELDS + (ATTRACTION_FIELDS if coupled else 0)
    return 8 * fields * points**2 * surfaces


def free_bytes(device: torch.device) -> int | None:
    """Bytes free on the device, or None where the system does not state it."""
    if device.type == "cuda":
        return int(torch.cuda.mem_get_info(device)[0])
    try:
        with Path("/proc/meminfo").open(encoding="ascii") as lines:
            for line in lines:
                if line.startswith("MemAvailable:"):
                    return int(line.split()[1]) * 1024
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, AttributeError):
        return None


def check_memory(points: int, surfaces: int, coupled: bool, device: torch.device) -> None:
    """Raise `InputError` where the estimate is above the free memory."""
    needed, free = estimated_bytes(points, surfaces, coupled), free_bytes(device)
    if free is not None and needed > free:
        raise InputError(
            f"expected a solve that fits into the {free / 2**30:.3g} GiB free on {device}, got one "
            f"of about {needed / 2**30:.3g} GiB ({surfaces} surface(s) of {points} x {points} "
            "pixels at a time); take fewer points or fewer surfaces at a time"
        )


def surfaces_that_fit(points: int, device: torch.device) -> int:
    """Largest batch that leaves half of the free memory alone, at least 1."""
    free = free_bytes(device)
    return 1 if free is None else max(1, free // 2 // estimated_bytes(points, 1))
