"""Tasks of sensing: enroll a person's finger by the current that it draws."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from datetime import date
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from haptix.base.errors import InputError
from haptix.base.fields import Address, Argument, Force, NewDocument, check_new
from haptix.base.report import record
from haptix.base.task import Context, Result
from haptix.model.presets import DEFAULT_CARRIER_HZ, FORCES_N, FingerName
from haptix.tasks.strokes import OnScreen

if TYPE_CHECKING:
    from haptix.model.friction import ContactModel
    from haptix.play.render import LiveRenderer
    from haptix.play.sensing import FingerObserver
    from haptix.play.virtual_finger import VirtualCurrent

_WAITS_S = 60.0
"""Longest time for a slide."""

_WIDTH_MM = 60.0
_SPEED_MM_PER_S = 50.0  # of a virtual finger, which slides to and fro over the width
_STEP_S = 0.01
_UNTOUCHED_S = 0.5  # for the panel's own current


class Enroll(OnScreen, command="enroll"):
    """Learn a person's finger from the current that it draws while it slides for 5 s.

    On a mock device a virtual finger slides. The file is for `LiveRenderer`, and for `haptix
    calibrate check --before`.
    """

    out: Annotated[NewDocument, Argument] = Field(description="File for the finger, JSON.")
    device: Address = Field(
        "mock:pace=stepped,mode=envelope,sense_rate_hz=250",
        description="The driver, with a sensor and a carrier of its own.",
    )
    normal_force_n: Force = Field(
        0.4, description="Force with which the person presses, by a scale under the screen."
    )
    seconds: Annotated[float, Field(ge=0.5, le=60)] = Field(5.0, description="Of sliding.")
    overwrite: bool = Field(False, description="Replace an existing file.")
    slider: FingerName | None = Field(
        None, description="Finger that slides on a mock device. [default: the finger]"
    )

    def run(self, context: Context) -> Result:
        """Enroll."""
        check_new(self.out, self.overwrite)
        import numpy as np

        from haptix.feel.materials import Texture
        from haptix.model.surface import cached_surface
        from haptix.play.devices import open_device
        from haptix.play.render import LiveRenderer, LiveSettings
        from haptix.play.sensing import ContactCurrent, FingerObserver

        model = self.model()
        with closing(open_device(self.device)) as device:
            if not device.capabilities.sense_rate_hz or device.mode != "envelope":
                raise InputError(
                    "--device: expected a driver with a sensor of current and mode=envelope, got "
                    f"{device.name}; for a mock leave it out"
                )
            scene = {"normal_force_n": FORCES_N, "frequency_hz": DEFAULT_CARRIER_HZ}
            surface, _ = cached_surface(model, scene, "0.05 JND")
            surface = surface.limited(device.limits.ceiling_v)
            observer = FingerObserver(ContactCurrent.of_surface(surface, DEFAULT_CARRIER_HZ))
            level = np.tile([0.3, 0.9], (2, 8))  # voltages differ along a stroke
            texture = Texture(level, width_mm=_WIDTH_MM, beyond="hold")
            settings = LiveSettings(strict=False)
            with LiveRenderer(surface, texture, device, None, settings, observer) as renderer:
                virtual = None if device.mock is None else self._virtual(model)
                slid_s = self._slide(
                    renderer, observer, virtual, lambda share: context.progress("sliding", share)
                )
        if slid_s < self.seconds:
            raise InputError(
                f"expected {self.seconds:g} s of sliding within {_WAITS_S:g} s, got {slid_s:.1f} s "
                f"({observer.estimate(renderer.now_s()).state}); slide to and fro with one finger"
            )
        person = observer.enrolled(model.screen.name).replace(day=date.today())
        person.save(self.out)
        estimate = observer.estimate(renderer.now_s())
        title = f"{self.out}: {slid_s:.1f} s of sliding at {self.normal_force_n:g} N"
        return Result({"file": str(self.out), **record(estimate)}, [(title, [str(estimate)])])

    def _slide(
        self,
        renderer: LiveRenderer,
        observer: FingerObserver,
        virtual: VirtualCurrent | None,
        tell: Callable[[float], None],
    ) -> float:
        """Pass touches of the driver's panel until the observer has learned for long enough.

        A virtual finger slides on a mock. Returns the time of sliding that counted [s]; less than
        `seconds` if that took over `_WAITS_S`.
        """
        from haptix.play.sensing import Knowledge
        from haptix.play.virtual_finger import LiveCurrent

        device, force_n, slid_s = renderer.device, self.normal_force_n, 0.0
        live = None if virtual is None else LiveCurrent.on(device, virtual)
        device.touches()  # of the time before
        began_s = at_s = renderer.now_s()
        while slid_s < self.seconds and at_s - began_s < _WAITS_S:
            at_s += _STEP_S
            renderer.run_until(at_s)
            if live is not None and at_s - began_s > _UNTOUCHED_S:
                turns = (at_s - began_s - _UNTOUCHED_S) * _SPEED_MM_PER_S / _WIDTH_MM % 2
                x_mm = _WIDTH_MM * min(turns, 2 - turns)
                live.touch(at_s, x_mm, 10.0, force_n)
                renderer.touch(at_s, x_mm, 10.0, force_n)
            for report in device.touches():
                reported_s = device.host_time_s(report.clock_ticks)
                if report.phase.name == "UP":
                    renderer.lift(reported_s, report.contact)
                else:
                    place_mm = report.x_um / 1e3, report.y_um / 1e3
                    renderer.touch(reported_s, *place_mm, force_n, report.contact)
            if observer.estimate(renderer.now_s()).state is Knowledge.LEARNS:
                slid_s += _STEP_S
            tell(min(slid_s / self.seconds, 1.0))
        return slid_s

    def _virtual(self, model: ContactModel) -> VirtualCurrent:
        """Return the current of the finger that slides on a mock."""
        from haptix.model.finger import Finger
        from haptix.model.friction import ContactModel
        from haptix.play.virtual_finger import VirtualCurrent

        slider = model.finger if self.slider is None else Finger.named(self.slider)
        contact = ContactModel(slider, model.screen, terms=model.terms)
        return VirtualCurrent(contact, DEFAULT_CARRIER_HZ)
