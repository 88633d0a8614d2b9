"""The component of PsychoPy's Builder: writes the code that plays a stimulus in a routine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from psychopy.experiment.components import BaseComponent, Param


class HapticStimulusComponent(BaseComponent):
    """Friction of a file that ``haptix stimuli make`` wrote, on an electrovibration screen."""

    categories = ("Stimuli", "I/O")
    targets = ("PsychoPy",)
    iconFile = Path(__file__).parent / "haptix.png"
    tooltip = "Haptic stimulus: play a haptix drive file on an electrovibration screen"
    plugin = "psychopy-haptix"

    def __init__(
        self,
        exp: Any,
        parentName: str,
        name: str = "haptic",
        startType: str = "time (s)",
        startVal: Any = 0.0,
        stopType: str = "duration (s)",
        stopVal: Any = "",
        startEstim: str = "",
        durationEstim: str = "",
        saveStartStop: bool = True,
        address: str = "mock:pace=real",
        stimulus: str = "",
        code: Any = 0,
        **others: Any,
    ) -> None:
        super().__init__(
            exp,
            parentName,
            name,
            startType=startType,
            startVal=startVal,
            stopType=stopType,
            stopVal=stopVal,
            startEstim=startEstim,
            durationEstim=durationEstim,
            saveStartStop=saveStartStop,
            **others,
        )
        self.type = "HapticStimulus"
        self.exp.requireImport(importName="HapticStimulus", importFrom="psychopy_haptix.session")
        self.params["stimulus"] = Param(
            stimulus,
            valType="file",
            inputType="file",
            categ="Basic",
            updates="set every repeat",
            allowedUpdates=["set every repeat"],
            hint="WAV or FLAC of a set that haptix stimuli make wrote, beside its JSON",
            label="Stimulus",
        )
        self.params["code"] = Param(
            code,
            valType="code",
            inputType="single",
            categ="Data",
            updates="set every repeat",
            allowedUpdates=["set every repeat"],
            hint="Number that marks its first sample, 0 to 65535",
            label="Marker code",
        )
        self.params["address"] = Param(
            address,
            valType="str",
            inputType="single",
            categ="Hardware",
            hint="Address of the device, such as usb: or mock:pace=real; see haptix devices",
            label="Device",
        )

    def _write(self, buff: Any, code: str) -> None:
        buff.writeIndentedLines(code.format(**self.params))

    def writeInitCode(self, buff: Any) -> None:
        """Write what opens the device, once for all components that share it."""
        self._write(buff, "{name} = HapticStimulus({address})\n")

    def writeRoutineStartCode(self, buff: Any) -> None:
        """Write what reads the file of this repeat."""
        self._write(buff, "{name}.load({stimulus}, {code}, globalClock.getTime)\n")

    def writeFrameCode(self, buff: Any) -> None:
        """Write what starts it, sees its end, and stops it."""
        if indented := self.writeStartTestCode(buff):
            self._write(buff, "{name}.play()\n")
            buff.setIndentLevel(-indented, relative=True)
        self._write(buff, "if {name}.status == STARTED and {name}.is_done:\n")
        self._write(buff, "    {name}.stop()\n    {name}.status = FINISHED\n")
        # PsychoPy before 2023.1 writes a test for an end that is not given.
        if str(self.params["stopVal"].val) in ("", "None", "-1"):
            return
        if indented := self.writeStopTestCode(buff):
            self._write(buff, "{name}.stop()\n")
            buff.setIndentLevel(-indented, relative=True)

    def writeRoutineEndCode(self, buff: Any) -> None:
        """Write what stops it, and adds its data to the row."""
        self._write(buff, "{name}.stop()\n")
        for value in ("onset", "onset_by", "code", "sha256"):
            self._write(buff, f"thisExp.addData('{{name}}.{value}', {{name}}.{value})\n")
        super().writeRoutineEndCode(buff)

    def writeExperimentEndCode(self, buff: Any) -> None:
        """Write what closes the device."""
        self._write(buff, "{name}.close()\n")
