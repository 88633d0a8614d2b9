"""Drive samples in audio files: float32 or 24-bit, in shares of a full-scale voltage."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
from pathlib import Path
from typing import Literal, Self, get_args

import numpy as np
import numpy.typing as npt
import soundfile

from haptix.base.checks import choice
from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import reading

Array = npt.NDArray[np.float64]
Container = Literal["wav", "flac"]
Encoding = Literal["float32", "24-bit"]

_CODES = 1 << 23  # positive codes of 24 bits; every reader divides by this
_FULL_BYTES = 1_000_000  # a disk with less free space counts as full: a block has at most that
_LARGEST_WAV = 4_000_000_000  # bytes: sizes in the header have 32 bits
MOST_SAMPLES = 50_000_000
"""Largest number of samples that is read or resampled at once: 17 minutes at 48 kHz, 0.4 GB."""
HIGHEST_RATE_HZ = 1_000_000
"""Highest sample rate, above those of all interfaces. It bounds the filter that resamples, which
has 20 coefficients per hertz at most."""


def check_format(container: str, encoding: str) -> None:
    """Raise `InputError` for a combination that cannot be written."""
    choice("format", container, get_args(Container))
    choice("encoding", encoding, get_args(Encoding))
    if (container, encoding) == ("flac", "float32"):
        raise InputError('encoding: FLAC holds integers; choose "24-bit", or format "wav"')


def step_v(encoding: Encoding, full_scale_v: float, at_v: float) -> float:
    """Return the quantisation step [V] at a voltage."""
    if encoding == "24-bit":
        return full_scale_v / _CODES
    return float(np.spacing(np.float32(abs(at_v) / full_scale_v))) * full_scale_v


class AudioWriter:
    """Writes a file in blocks; the file is complete when the context ends without an error.

    Parameters
    ----------
    container, encoding : str
        "wav" or "flac"; "float32" or "24-bit".
    sample_rate_hz : float
        A whole number.
    full_scale_v : float
        Voltage of sample 1.0; must be above every sample.
    samples : int
        Number of samples to come; more than a file can hold are refused.
    trigger : bool
        Whether a second channel holds triggers.
    """

    def __init__(
        self,
        path: Path,
        container: Container,
        encoding: Encoding,
        sample_rate_hz: float,
        full_scale_v: float,
        samples: int,
        trigger: bool,
    ) -> None:
        check_format(container, encoding)
        channels = 2 if trigger else 1
        if container == "wav" and samples * channels * 4 > _LARGEST_WAV:
            raise InputError(
                f"{path.name}: {samples} samples are more than a WAV file holds; make it shorter, "
                'or choose format "flac"'
            )
        self.path = path
        self._encoding = encoding
        self._full_scale_v = full_scale_v
        subtype = "FLOAT" if encoding == "float32" else "PCM_24"
        kind = "WAV" if container == "wav" else "FLAC"
        try:
            self._file = soundfile.SoundFile(
                path, "w", round(sample_rate_hz), channels, subtype, format=kind
            )
        except soundfile.SoundFileError as error:
            raise _failure("begin", path, error) from None

    def write(self, drive_v: Array, trigger: npt.NDArray[np.float32] | None) -> None:
        """Append samples, or raise `OSError` if the disk takes no more."""
        shares: Array = drive_v[:, None] / self._full_scale_v
        if trigger is not None:
            shares = np.column_stack([shares, trigger])
        try:
            if self._encoding == "float32":
                self._file.write(shares.astype(np.float32))
            else:
                self._file.write(np.rint(shares * _CODES).astype(np.int32) << 8)
        # soundfile asserts that all samples were written.
        except (AssertionError, soundfile.SoundFileError) as error:
            raise _failure("write all of", self.path, error) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        try:
            self._file.close()
            if error is None:
                _forget_time(self.path)
        except soundfile.SoundFileError as failure:
            raise _failure("finish", self.path, failure) from None


def _failure(did: str, path: Path, error: Exception) -> OSError:
    """Return the error; libsndfile says "System error." for a full disk and for all others."""
    if shutil.disk_usage(path.parent).free < _FULL_BYTES:
        return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
    return OSError(f"cannot {did} {path.name}: {error}")


def _forget_time(path: Path) -> None:
    """Clear the time of writing in a float WAV file, so that equal samples make equal files."""
    with path.open("r+b") as file:
        head = file.read(4096)
        at = head.find(b"PEAK")
        if head[:4] == b"RIFF" and at > 0:
            file.seek(at + 12)  # after name, size and version
            file.write(bytes(4))


def file_hash(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_audio(path: str | Path, first: int = 0, count: int = -1) -> tuple[Array, int]:
    """Read samples, shape (samples, channels), and the sample rate of a WAV or FLAC file.

    Raises `FileFormatError` if it is no such file, or more than 50 million samples are asked for;
    its header is read first.
    """
    with reading(path, "a WAV or FLAC file"), Path(path).open("rb") as opened:
        # libsndfile has decoders for many more formats, which are not needed here.
        head = opened.read(8)
        if head[:4] not in (b"RIFF", b"fLaC"):
            raise ValueError("it begins otherwise")
        # The library reads a file that was cut off as a shorter one. A program that wrote into a
        # pipe could not know the size, and states 0 or the highest.
        stated, there = int.from_bytes(head[4:], "little"), opened.seek(0, os.SEEK_END) - 8
        if head[:4] == b"RIFF" and there < stated < 2**32 - 1:
            raise ValueError(f"it states {stated} bytes and has {there}; copy it again")
        opened.seek(0)
        with soundfile.SoundFile(opened) as file:
            frames = file.frames - first if count < 0 else min(count, file.frames - first)
            samples, rate = frames * file.channels, file.samplerate
            if samples > MOST_SAMPLES or not 0 < rate <= HIGHEST_RATE_HZ:
                raise FileFormatError(
                    f"{path}: expected at most {MOST_SAMPLES} samples and "
                    f"{HIGHEST_RATE_HZ} of them per second, got {samples} and {rate}; cut it "
                    "into shorter files"
                )
            file.seek(first)
            data = file.read(count, dtype="float64", always_2d=True)
            if len(data) != frames:
                raise ValueError(f"it states {frames} samples and has {len(data)}; copy it again")
            return data, rate


def count_samples(path: str | Path) -> int:
    """Count the samples of a WAV or FLAC file, of all channels, by its header.

    Raises `FileFormatError` if it is no such file.
    """
    with reading(path, "a WAV or FLAC file"), soundfile.SoundFile(path) as file:
        return int(file.frames * file.channels)


def read_drive(
    path: str | Path, full_scale_v: float, first: int = 0, count: int = -1
) -> tuple[Array, Array | None, float]:
    """Read volts, triggers (None without) and sample rate of a file.

    Raises `FileFormatError` if it is not an audio file of one or two channels.
    """
    data, rate = read_audio(path, first, count)
    if data.shape[1] not in (1, 2):
        raise FileFormatError(f"{path}: expected 1 or 2 channels, got {data.shape[1]}")
    return data[:, 0] * full_scale_v, data[:, 1] if data.shape[1] == 2 else None, float(rate)
