"""Recordings and pictures that were cut off or changed are refused, not read as something else."""

import io
import struct

import numpy as np
import pytest
import soundfile
from PIL import Image

from haptix.base.errors import FileFormatError, InputError
from haptix.feel import Texture
from haptix.feel.signals.audio_files import read_audio

RNG = np.random.default_rng(0)


@pytest.fixture(params=["wav", "flac"])
def recording(request, tmp_path):
    path = tmp_path / f"a.{request.param}"
    soundfile.write(path, RNG.uniform(-0.5, 0.5, 5000), 48_000, subtype="PCM_16")
    return path


def test_a_recording_that_was_cut_off_is_refused(recording):
    whole = recording.read_bytes()
    assert len(read_audio(recording)[0]) == 5000
    for share in (0.3, 0.6, 0.9, 0.999):
        recording.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(FileFormatError):
            read_audio(recording)


@pytest.mark.parametrize("stated", [0, 2**32 - 1])
def test_a_recording_from_a_pipe_is_read(tmp_path, stated):
    """It could not know its size when it was begun."""
    path = tmp_path / "a.wav"
    soundfile.write(path, np.zeros(5000), 48_000, subtype="PCM_16")
    data = bytearray(path.read_bytes())
    data[4:8] = struct.pack("<I", stated)
    path.write_bytes(data)
    assert read_audio(path)[0].shape == (5000, 1)


def test_a_picture_whose_pixels_changed_is_refused(tmp_path):
    """A bit in each tenth byte of its pixels: Pillow compares their sums."""
    file = io.BytesIO()
    Image.fromarray(RNG.integers(0, 256, (24, 32), np.uint8)).save(file, "PNG")
    whole = file.getvalue()
    path = tmp_path / "a.png"
    path.write_bytes(whole)
    Texture.from_image(path, width_mm=40.0, low=0.3, high=0.6)
    begin = whole.index(b"IDAT") + 4
    for at in range(begin, whole.index(b"IEND") - 8, 10):
        damaged = bytearray(whole)
        damaged[at] ^= 8
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="image"):
            Texture.from_image(path, width_mm=40.0, low=0.3, high=0.6)
