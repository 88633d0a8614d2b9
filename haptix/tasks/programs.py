"""A task of programs of a touch."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from haptix.base.errors import InputError
from haptix.base.fields import (
    Address,
    Argument,
    FileThere,
    Folder,
    MaterialFile,
    NewFile,
    check_new,
)
from haptix.base.files import write_whole
from haptix.base.task import Context, Result
from haptix.model.presets import DEFAULT_CARRIER_HZ, FORCES_N
from haptix.tasks.strokes import CarrierHz, OnScreen

if TYPE_CHECKING:
    from haptix.feel.materials import Material

_TOLERANCE = "0.05 JND"


class Compile(OnScreen, command="compile"):
    """Compile a layout to a program of a touch, which a web page plays without a service."""

    layout: Annotated[MaterialFile, Argument] = Field(
        description="Layout or material: TOML or JSON, or gallery:NAME."
    )
    surface: FileThere | None = Field(
        None, description="Surface of `haptix build`. [default: built for finger and screen]"
    )
    carrier_hz: CarrierHz = Field(DEFAULT_CARRIER_HZ, description="Frequency of the carrier.")
    device: Address = Field("mock:", description="Driver whose sample rate and limits count.")
    out: NewFile = Field(Path("touch.hxp"), description="File to write.")
    page: Folder | None = Field(
        None, description="Folder to write instead: a page that any web server can serve."
    )
    overwrite: bool = Field(False, description="Replace an existing file.")

    def run(self, context: Context) -> Result:
        """Write the file."""
        from haptix.feel.gallery import load

        out = self.out if self.page is None else self.page / "touch.hxp"
        has_files = self.page is not None and self.page.is_dir() and any(self.page.iterdir())
        if has_files and not self.overwrite:
            raise InputError(
                f"{self.page} has files: name another folder, or pass --overwrite to replace "
                "those of a page"
            )
        check_new(out, self.overwrite, *(p for p in (self.layout, self.surface) if p is not None))
        felt = load(self.layout)
        update = partial(context.progress, "build the surface")
        update(0.0)
        program = compiled(
            felt, self.finger, self.screen, self.surface, self.carrier_hz, self.device, update
        )
        if self.page is not None:
            from haptix.play.touch_page import page_files

            title = self.layout.name.removeprefix("gallery:").partition(".")[0]
            self.page.mkdir(parents=True, exist_ok=True)
            for name, content in page_files(program, felt, title).items():
                write_whole(self.page / name, content)
        else:
            write_whole(out, program)
        rows = [{"file": str(out), "bytes": len(program)}]
        return Result(rows, [("compiled", rows)])


def compiled(
    felt: Material,
    finger: str | None,
    screen: str | None,
    surface: Path | None = None,
    carrier_hz: float = DEFAULT_CARRIER_HZ,
    device: str = "mock:",
    update: Callable[[float], None] | None = None,
) -> bytes:
    """Return the program of a touch of a material; see `Compile`."""
    from haptix.model.friction import ContactModel
    from haptix.model.pair import profiles
    from haptix.model.surface import FrictionSurface, cached_surface
    from haptix.play.devices import open_device, profiles_for
    from haptix.play.render import SineCarrier, compile_touch

    with closing(open_device(device)) as opened:
        model = ContactModel(*profiles(*profiles_for(opened, finger, screen)))
        if surface is not None:
            table = FrictionSurface.load(surface, model)
        else:
            scene = {"normal_force_n": FORCES_N, "frequency_hz": carrier_hz}
            table, _ = cached_surface(model, scene, _TOLERANCE, update)
        table = table.limited(opened.limits.ceiling_v)
        return compile_touch(table, felt, opened, SineCarrier(carrier_hz))
