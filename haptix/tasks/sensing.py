"""Tasks of sensing: enroll a person's finger by the current that it draws."""

from __future__ import annotations

from contextlib import closing
from datetime import date
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from haptix.desk import Context, Result
from haptix.errors import InputError
from haptix.fields import Address, Argument, FingerName, Force, NewDocument, check_new
from haptix.report import record
from haptix.tasks.rendering import FORCES_N, OnScreen

if TYPE_CHECKING:
    from haptix.friction import ContactModel
    from haptix.virtual_finger import VirtualCurrent


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
        from haptix.devices import open_device
        from haptix.render import LiveRenderer, LiveSettings
        from haptix.render.samples import DEFAULT_CARRIER_HZ
        from haptix.render.sensed_slide import WAITS_S, WIDTH_MM, sensed_slide
        from haptix.sensing import ContactCurrent, FingerObserver
        from haptix.surface import cached_surface
        from haptix.texture import Texture

        model = self.model()
        with closing(open_device(self.device)) as device:
            if not device.capabilities.sense_rate_hz or device.mode != "envelope":
                raise InputError(
                    "--device: expected a driver with a sensor of current and mode=envelope, got "
                    f"{device.name}; for a mock leave it out"
                )
            scene = {"normal_force_n": FORCES_N, "frequency_hz": DEFAULT_CARRIER_HZ}
            surface, _ = cached_surface(model, scene, "0.05 JND")
            observer = FingerObserver(ContactCurrent.of_surface(surface, DEFAULT_CARRIER_HZ))
            level = np.tile([0.3, 0.9], (2, 8))  # voltages differ along a stroke
            texture = Texture(level, width_mm=WIDTH_MM, beyond="hold")
            settings = LiveSettings(strict=False)
            with LiveRenderer(surface, texture, device, None, settings, observer) as renderer:
                virtual = None if device.mock is None else self._virtual(model)
                slid_s = sensed_slide(
                    renderer,
                    observer,
                    self.seconds,
                    self.normal_force_n,
                    virtual,
                    lambda share: context.progress("sliding", share),
                )
        if slid_s < self.seconds:
            raise InputError(
                f"expected {self.seconds:g} s of sliding within {WAITS_S:g} s, got {slid_s:.1f} s "
                f"({observer.estimate(renderer.now_s()).state}); slide to and fro with one finger"
            )
        person = observer.enrolled(model.screen.name).replace(day=date.today())
        person.save(self.out)
        estimate = observer.estimate(renderer.now_s())
        title = f"{self.out}: {slid_s:.1f} s of sliding at {self.normal_force_n:g} N"
        return Result({"file": str(self.out), **record(estimate)}, [(title, [str(estimate)])])

    def _virtual(self, model: ContactModel) -> VirtualCurrent:
        """Return the current of the finger that slides on a mock."""
        from haptix.finger import Finger
        from haptix.friction import ContactModel
        from haptix.render.samples import DEFAULT_CARRIER_HZ
        from haptix.virtual_finger import VirtualCurrent

        slider = model.finger if self.slider is None else Finger.named(self.slider)
        contact = ContactModel(slider, model.screen, terms=model.terms)
        return VirtualCurrent(contact, DEFAULT_CARRIER_HZ)
