"""A task of programs of a touch."""

from __future__ import annotations

from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Annotated

from pydantic import Field

from haptix.base.fields import Address, Argument, FileThere, MaterialFile, NewFile, check_new
from haptix.base.files import write_whole
from haptix.base.task import Context, Result
from haptix.model.presets import DEFAULT_CARRIER_HZ, FORCES_N
from haptix.tasks.strokes import CarrierHz, OnScreen

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
    overwrite: bool = Field(False, description="Replace an existing file.")

    def run(self, context: Context) -> Result:
        """Write the file."""
        context.progress("build the surface", 0.0)
        from haptix.feel.gallery import load
        from haptix.model.surface import FrictionSurface, cached_surface
        from haptix.play.devices import open_device, profiles_for
        from haptix.play.render import SineCarrier, compile_touch

        inputs = [path for path in (self.layout, self.surface) if path is not None]
        check_new(self.out, self.overwrite, *inputs)
        felt = load(self.layout)
        with closing(open_device(self.device)) as opened:
            finger, screen = profiles_for(opened, self.finger, self.screen)
            model = self.model_copy(update={"finger": finger, "screen": screen}).model()
            if self.surface is not None:
                surface = FrictionSurface.load(self.surface, model)
            else:
                scene = {"normal_force_n": FORCES_N, "frequency_hz": self.carrier_hz}
                update = partial(context.progress, "build the surface")
                surface, _ = cached_surface(model, scene, _TOLERANCE, update)
            surface = surface.limited(opened.limits.ceiling_v)
            program = compile_touch(surface, felt, opened, SineCarrier(self.carrier_hz))
        write_whole(self.out, program)
        rows = [{"file": str(self.out), "bytes": len(program)}]
        return Result(rows, [("compiled", rows)])
