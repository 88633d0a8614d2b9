"""A program of a touch: all that an engine needs to play a layout, as bytes without code.

`haptix/base/native/haptix_engine.c` plays it: on a host, or in a web page without a service.
docs/program.md describes the format.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from firmware_io import Device
from haptix.base.errors import InputError
from haptix.feel.layout.program import TARGETS, FeltRecords, Sections
from haptix.feel.materials import Evaluator, Feelable
from haptix.model.surface import FrictionSurface
from haptix.play.render.drive import Drive
from haptix.play.render.samples import COMBINATIONS, RenderCore
from haptix.play.render.settings import LiveSettings
from haptix.play.touch import InteractingSinger

MAGIC = b"\x89HXP\r\n\x1a\n"
"""First bytes; a transfer as text changes them."""

VERSION = 2
_HEADER = struct.Struct("<8s18I31d")
_CHECKED_FROM = 16  # the checksum is that of all bytes from here on


def compile_touch(
    surface: FrictionSurface,
    texture: Feelable,
    device: Device,
    drive: Drive | None = None,
    settings: LiveSettings | None = None,
) -> bytes:
    """Compile what a renderer would play to a program of a touch, the bytes of a ``.hxp`` file.

    Maps are rounded to single precision, by less than 1e-6 of the friction.

    Parameters
    ----------
    surface, texture, device, drive
        See `haptix.play.RenderCore`. The device gives the sample rate and the limits.
    settings : LiveSettings, optional
        How touches are followed and friction becomes an amplitude.

    Raises
    ------
    InputError
        If a material cannot be compiled, with the name of its region; or the drive is no carrier
        that repeats within 4096 samples.

    Examples
    --------
    >>> import haptix
    >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
    >>> scene = {"normal_force_n": 0.5, "frequency_hz": 4000.0}
    >>> surface = haptix.FrictionSurface.build(model, scene, 0.01)
    >>> layout = haptix.Layout()
    >>> ribs = layout.add(haptix.feel.Grating(period_mm=2.0), width_mm=60, height_mm=40)
    >>> device = haptix.open_device("mock:")
    >>> program = compile_touch(surface, layout, device)
    >>> device.close()
    >>> program[1:4], len(program) < 5000
    (b'HXP', True)
    """
    settings = LiveSettings() if settings is None else settings
    core = RenderCore(surface, texture, device, drive, settings)
    return compile_core(core, settings).program


Maps = Sequence[tuple[Evaluator, int]]


class Compiled(NamedTuple):
    """A program of a touch, and how its regions glide."""

    program: bytes
    glides: tuple[tuple[Any, ...], ...]
    """Of each region, the lowest first, the numbers of an ``hx_glide`` of the engine."""
    maps: Maps
    """Materials with maps, and their numbers."""


def compile_core(
    core: RenderCore,
    settings: LiveSettings,
    moving: bool = False,
    felt: Evaluator | None = None,
    kept: Maps = (),
) -> Compiled:
    """Compile what a core renders; see `compile_touch`.

    Parameters
    ----------
    core : RenderCore
    settings : LiveSettings
    moving : bool
        Follow regions that glide and fade; without it, all are as they will be at rest.
    felt : Evaluator, optional
        In place of the core's texture.
    kept : sequence of (Evaluator, int)
        `Compiled.maps` of the program that it follows; their maps are not written again.

    Raises
    ------
    InputError
        As `compile_touch`.
    """
    wave = core.drive.period(core.sample_rate_hz)
    if core.drive.attraction is not None:
        raise InputError(
            "drive: expected a carrier, which a program of a touch holds; a direct drive is played "
            "by a renderer of the host"
        )
    if wave is None:
        raise InputError(
            f"drive: expected a carrier that repeats within 4096 samples at "
            f"{core.sample_rate_hz:g} per second, got {core.drive.frequency_hz:g} Hz; take a whole "
            "number of hundreds"
        )
    how = settings.touch.filter
    if type(how) is not InteractingSinger:
        raise InputError(
            f"touch: expected the filter InteractingSinger, which the engine has, got "
            f"{type(how).__name__}"
        )
    sections = Sections(_HEADER.size)
    table, touch, sliding = core.slice, settings.touch, settings.sliding
    numbers = [np.log(table.force_n), table.drive, table.columns]
    slice_at = sections.add(b"".join(part.astype("<f8").tobytes() for part in numbers))
    wave_at = sections.add(wave.astype("<f8").tobytes())
    records = FeltRecords(felt or core.texture.evaluator, sections, moving, kept)
    materials_at, regions_at = (
        sections.add(b"".join(rows)) for rows in (records.materials, records.regions)
    )
    low, high = settings.compress or (0.0, 0.0)
    compresses = settings.compress is not None and records.target != "share"
    at_rest = core.drives_at_rest or not settings.sliding.is_needed
    flags = compresses + 2 * at_rest + 4 * records.is_layout
    fields = (
        sections.size, core.step, TARGETS.index(records.target),
        COMBINATIONS.index(settings.combination), flags, len(table.force_n),
        len(table.drive), int(table.limited_by), len(wave), len(records.materials),
        len(records.regions), records.background, slice_at, wave_at, materials_at, regions_at,
    )  # fmt: skip
    reals = (
        core.sample_rate_hz, core.drive.frequency_hz, core.highest_v, core.most_step_v, low, high,
        table.unit_v, table.limit_v, table.pull_in_drive, *table.ends_n, touch.force.assumed_n,
        touch.latency_s, touch.lost_after_s, touch.blend_s, sliding.fade_s,
        touch.slide_above_mm_s, touch.rest_below_mm_s, how.acceleration_mm_s2,
        how.acceleration_per_speed_hz, how.correlation_s, how.position_noise_mm,
        how.first_speed_mm_s, how.noise_reports, how.gentle, how.stay, touch.turn_above_mm_s,
        touch.turn_s, touch.slide_smoothing_s, touch.reorder_s, touch.least_interval_s,
    )  # fmt: skip
    header = _HEADER.pack(MAGIC, VERSION, 0, *fields, *reals)
    checked = header[_CHECKED_FROM:] + sections.parts
    program = MAGIC + struct.pack("<II", VERSION, zlib.crc32(checked)) + checked
    return Compiled(program, records.glides, records.maps)
