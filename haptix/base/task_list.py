"""The table of all tasks: their commands, classes and first sentences. It loads none of them.

A new task is a class with its ``command`` or ``route``, and a row here; a test compares both.
"""

from __future__ import annotations

TASKS: dict[str, tuple[str, str]] = {
    "demo": ("haptix.tasks.strokes:Demo", "From a photograph to what a finger feels: everything once, without hardware."),
    "render": ("haptix.tasks.strokes:Render", "Simulate live touches: a virtual finger feels the drive, and the error is split."),
    "play": ("haptix.tasks.strokes:PlayPath", "Play a recorded path on a device, in real time."),
    "compile": ("haptix.tasks.programs:Compile", "Compile a layout to a program of a touch, which a web page plays without a service."),
    "build": ("haptix.tasks.surfaces:Build", "Solve the contact model once and write its friction surface."),
    "query": ("haptix.tasks.surfaces:Query", "Friction for a force and a voltage, from the model or from a surface."),
    "reach": ("haptix.tasks.surfaces:Reach", "Lowest and highest friction that a surface offers for a finger, and what limits it."),
    "invert": ("haptix.tasks.surfaces:Invert", "Voltage for a friction, with the status of each, such as OK, BELOW, ABOVE or FRICTION."),
    "export": ("haptix.tasks.surfaces:Export", "Write a surface's numbers as NetCDF, for other programs; needs xarray and h5netcdf."),
    "cache": ("haptix.tasks.surfaces:ListCache", "List the results that are kept so that they are not made twice, or remove them."),
    "plan": ("haptix.tasks.surfaces:PlanScene", "Measure the effect of each part of the model in a scene, and drop what its budget allows."),
    "tradeoff": ("haptix.tasks.surfaces:TradeOff", "Measure error, build time, query time and memory of many ways to build a scene's surface."),
    "finger": ("haptix.tasks.fingers:MakeFinger", "Make a finger of a height map, line scans or a spectrum, and of a dielectric table."),
    "material show": ("haptix.tasks.materials:ShowMaterial", "Draw a material: its friction by place, direction, speed, force and time."),
    "material kinds": ("haptix.tasks.materials:ListKinds", "List the kinds of materials with their fields."),
    "material gallery": ("haptix.tasks.materials:ListGallery", "List the presets of the gallery, which ``gallery:NAME`` names."),
    "material schema": ("haptix.tasks.materials:PrintSchema", "Print the JSON Schema of all materials."),
    "material fit": ("haptix.tasks.materials:FitMaterial", "Fit a compact material to a recording of friction in time, and compare what both give."),
    "material distance": ("haptix.tasks.materials:CompareMaterials", "Distance of two textures [dB]: recordings in time, or materials of mu or contrast."),
    "campaign": ("haptix.tasks.campaigns:RunCampaign", "Do many independent tasks: surfaces of many people and screens, calibrations, and more."),
    "enroll": ("haptix.tasks.enrolment:Enroll", "Learn a person's finger from the current that it draws while it slides for 5 s."),
    "stimuli make": ("haptix.tasks.stimuli:MakeSet", "Render a set: drive files with sidecars, trial table, contact sheet, manifest."),
    "stimuli again": ("haptix.tasks.stimuli:MakeAgain", "Make a drive file again from its sidecar and profiles.json; every byte must be the same."),
    "stimuli show": ("haptix.tasks.stimuli:ShowStimulus", "Draw a stimulus (waveform, spectrum, friction, thresholds, audibility), or check a set."),
    "stimuli run": ("haptix.tasks.stimuli:RunExperiment", "Run an adaptive experiment on a device; the task says which keys answer (1/2, l/r, y/n, s/d)."),
    "stimuli simulate": ("haptix.tasks.stimuli:Simulate", "Simulate a plan before the first session: how good its thresholds are, and its power."),
    "stimuli new": ("haptix.tasks.stimuli:NewStudy", "Begin a study: the frame of a BIDS data set, with code/experiment.toml to change."),
    "stimuli bids": ("haptix.tasks.stimuli:ExportBids", "Write a log into a study in the Brain Imaging Data Structure (BIDS)."),
    "stimuli analyse": ("haptix.tasks.stimuli:Analyse", "Analyse sessions: thresholds of each participant and condition, and over participants."),
    "calibrate plan": ("calibration.tasks:PlanStrokes", "Write the protocol, that is which strokes to make, and print the errors to expect."),
    "calibrate measure": ("calibration.tasks:Measure", "Play the protocol stroke by stroke. A stroke with a fault is repeated, a good one is kept."),
    "calibrate run": ("calibration.tasks:RunCalibration", "Check the rig, plan, measure, reduce, fit, verify. The same command again continues it."),
    "calibrate rig": ("calibration.tasks:CheckRig", "Check gain, sign and unit of both forces, the sensor's bandwidth, and the volts."),
    "calibrate reduce": ("calibration.result_tasks:Reduce", "Compute mu(F_N, V0, f) from the raw forces, and name the strokes that cannot be used."),
    "calibrate fit": ("calibration.result_tasks:FitSession", "Fit screen and finger, and report the parameters that the strokes determine."),
    "calibrate verify": ("calibration.result_tasks:Verify", "Verify the fit by strokes kept out of it; write profiles, report and archive."),
    "calibrate check": ("calibration.result_tasks:Check", "Compare new strokes with an existing profile: the drift since then, in JND."),
    "calibrate match": ("calibration.result_tasks:MatchScreens", "Find the friction that two screens can both give, and the voltages for it."),
    "calibrate install": ("calibration.result_tasks:Install", "Install a profile for a driver, by whose serial number `haptix render` and `play` find it."),
    "calibrate period": ("calibration.result_tasks:Period", "Find the spatial period of the touched surface, with its significance and its harmonic."),
    "calibrate instruments": ("calibration.keeping_tasks:CheckInstruments", "Check the dates of the instruments in a file, and of those that a session used."),
    "calibrate certificate": ("calibration.keeping_tasks:Certify", "Write the certificate of a session that passed, as a PDF beside its report."),
    "calibrate register": ("calibration.keeping_tasks:KeepRegister", "Keep the register of all panels: enter sessions, print states and due dates, write a page."),
    "calibrate batch": ("calibration.keeping_tasks:RunBatch", "Run panel after panel, each in a folder of its own. The same command again continues."),
    "service install": ("haptix.tasks.login:InstallService", "Start the service whenever you log in, and now. The same command again replaces it."),
    "service remove": ("haptix.tasks.login:RemoveService", "Stop the service, and start it no more. What you made stays: layouts, profiles, surfaces."),
    "service status": ("haptix.tasks.login:ServiceStatus", "Say whether the service starts when you log in, whether it runs, and where its log is."),
    "touchscreen calibrate": ("haptix.tasks.touchscreens:CalibrateTouchscreen", "Find how a touch panel lies on the picture, and its size, with a finger on four marks."),
    "calibrate standard": ("calibration.keeping_tasks:ChartStandard", "Enter strokes on a check standard into the register, and chart them over days."),
    "calibrate gauge": ("calibration.keeping_tasks:StudyGauge", "Find the shares of panels, operators and days in the variance of the measured values."),
    "calibrate columns": ("calibration.tasks:Columns", "Show how a recording of another program was understood, and propose its column map."),
}  # fmt: skip
"""``module:Class`` and first sentence of each task by the words of its command, as help lists them."""

GROUPS = {
    "material": "Tasks of materials, the documents of how a surface feels.",
    "stimuli": "Tasks of stimuli for perception experiments: make and draw sets, run and analyse trials.",
    "service": "The service at log-in: install, remove and ask for it.",
    "touchscreen": "Tasks of touch panels.",
    "calibrate": "Calibrate a screen: plan, measure, reduce, fit, verify; each step can be repeated.",
}
"""Sentences of commands whose second word is the task."""

WITHOUT_COMMAND = (
    "haptix.tasks.strokes:Headroom",
    "haptix.tasks.strokes:KeepSurface",
    "haptix.tasks.stimuli:ExperimentJob",
    "calibration.tasks:CalibrationJob",
)
"""Tasks with a route of the service alone."""


def commands() -> dict[str, tuple[str, str]]:
    """Return each task or group and its sentence, by the first word of its command.

    A task is ``module:Class``; a group has an empty path.
    """
    first_words: dict[str, tuple[str, str]] = {}
    for command, (path, sentence) in TASKS.items():
        word, _, rest = command.partition(" ")
        first_words.setdefault(word, ("", GROUPS[word]) if rest else (path, sentence))
    return first_words
