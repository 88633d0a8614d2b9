"""Tasks on measured strokes: reduce, fit, verify; compare, install; and the spatial period."""

from __future__ import annotations

from contextlib import closing
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, Field

from calibration.tasks import SessionThere
from haptix.base.errors import InputError
from haptix.base.fields import Address, Argument, FileThere, FolderThere, Positive, Text, Typed
from haptix.base.report import record, row
from haptix.base.task import Context, Result, Task
from haptix.model.presets import DEFAULT_CARRIER_HZ, FingerName, TermName

if TYPE_CHECKING:
    from calibration.plan.parameters import Array
    from haptix.model.friction import ContactModel
    from haptix.model.screen import Screen


def _numbers(text: str, form: str) -> tuple[str, tuple[float, ...]]:
    """Read a text such as ``h0_m=1.2e-7,0.1``, with as many numbers as `form` has."""
    name, _, values = text.partition("=")
    try:
        numbers = tuple(float(value) for value in values.split(","))
    except ValueError:
        numbers = ()
    is_whole = len(numbers) == form.count(",") + 1 and all(map(isfinite, numbers))
    if not (is_whole and name.strip()):
        raise ValueError(f"expected {form}, such as h0_m=1.2e-7, got {text!r:.80}")
    return name.strip(), numbers


def _of_form(form: str) -> AfterValidator:
    """Return the check of a text by `_numbers`."""

    def check(text: str) -> str:
        _numbers(text, form)
        return text

    return AfterValidator(check)


class Reduce(Task, command="calibrate reduce"):
    """Compute mu(F_N, V0, f) from the raw forces, and name the strokes that cannot be used."""

    folder: SessionThere

    def run(self, context: Context) -> Result:
        """Reduce."""
        from calibration.steps import REDUCED, reduce_folder

        reduced = reduce_folder(self.folder)
        rows = [{"stroke": point.number, **record(point)} for point in reduced.points]
        title = (
            f"{self.folder / REDUCED}: {len(reduced.used)} strokes to fit, "
            f"{len(reduced.held_out)} held out, {len(reduced.outliers)} not used"
        )
        return Result(rows, [(title, reduced.points)])


class FitSession(Task, command="calibrate fit"):
    """Fit screen and finger, and report the parameters that the strokes determine.

    A parameter that they do not determine has no value, but the experiment that would give one.
    """

    folder: SessionThere
    fix: tuple[Annotated[str, _of_form("NAME=VALUE")], ...] = Field(
        (), description="Hold a parameter: NAME=VALUE; may be repeated."
    )
    prior: tuple[Annotated[str, _of_form("NAME=VALUE,SPREAD")], ...] = Field(
        (), description="Prior: NAME=VALUE,SPREAD (0.1 for 10 %); may be repeated."
    )
    finger: FileThere | None = Field(
        None, description="fit.json of the same finger on another screen."
    )
    leaky_gap: bool = Field(False, description="Fit the resistivity of the gap.")
    with_terms: Annotated[tuple[TermName, ...], Typed("--with")] = Field(
        (), description="Switch a term on."
    )
    without_terms: Annotated[tuple[TermName, ...], Typed("--without")] = Field(
        (), description="Switch a term off."
    )
    compare: bool = Field(True, description="Find which terms the strokes need.")

    def run(self, context: Context) -> Result:
        """Fit."""
        from calibration.steps import FIT, fit_folder

        terms = dict.fromkeys(self.with_terms, True) | dict.fromkeys(self.without_terms, False)
        fixed = {name: value for name, (value,) in (_numbers(t, "NAME=VALUE") for t in self.fix)}
        priors: dict[str, tuple[float | None, float]] = {}
        for text in self.prior:
            name, (value, spread) = _numbers(text, "NAME=VALUE,SPREAD")
            priors[name] = value, spread
        fit, needs = fit_folder(
            self.folder, fixed, priors, self.finger, self.leaky_gap, terms or None, self.compare
        )
        shown = ("name", "value", "low", "high", "spread", "verdict")
        document = {
            "estimates": [record(estimate, shown) for estimate in fit.estimates],
            "advice": [estimate.refusal() for estimate in fit.undetermined],
            **record(fit, ("left_out", "theory", "repeatability", "forms")),
            "terms": record(needs),
        }
        title = (
            f"{self.folder / FIT}: {len(fit.strokes)} strokes, which {fit.scatter}; theory "
            f"{fit.theory}"
        )
        return Result(document, [(title, ()), *fit.parts(needs)])


class Verify(Task, command="calibrate verify"):
    """Verify the fit by strokes kept out of it; write profiles, report and archive.

    Exit code 1 if it fails.
    """

    folder: SessionThere
    tolerance_jnd: Positive = Field(
        0.5, description="Largest error, in just-noticeable differences (JND)."
    )

    def run(self, context: Context) -> Result:
        """Verify."""
        from calibration.steps import REPORT, verify_folder
        from haptix.model.pair import SCREEN

        verification, screen = verify_folder(self.folder, self.tolerance_jnd)
        written = "no profile" if screen is None else self.folder / SCREEN
        title = f"{verification.verdict}: {written}, {self.folder / REPORT}"
        tables = [(title, ()), *verification.parts]
        return Result(record(verification), tables, failed=bool(verification.failures))


class Check(Task, command="calibrate check"):
    """Compare new strokes with an existing profile: the drift since then, in JND.

    Passes if the mean change of friction, with its uncertainty, is within half a JND. Without a
    rig, give --before and --after: files of `haptix enroll` of one person. Passes if the contact's
    capacitance has changed by less than 6 %. Exit code 1 if not.
    """

    folder: Annotated[FolderThere | None, Argument] = Field(
        None, description="Folder of a session with new strokes."
    )
    profile: FileThere = Field(description="screen.toml of an earlier calibration.")
    before: FileThere | None = Field(None, description="Finger enrolled with the calibration.")
    after: FileThere | None = Field(None, description="The same person's finger, enrolled now.")
    finger: FingerName | None = Field(
        None, description="Finger: a preset or a file. [default: finger.toml beside the profile]"
    )

    def run(self, context: Context) -> Result:
        """Compare."""
        from calibration.keep.profile import check_profile
        from calibration.measure.session import Session
        from calibration.plan.predict import StrokePredictor
        from calibration.steps import reduce_folder
        from haptix.model.friction import ContactModel
        from haptix.model.pair import described, first_line, profiles

        by_current = self.before is not None and self.after is not None
        if (self.folder is None) != by_current or (self.before is None) != (self.after is None):
            raise InputError("expected a session's folder, or --before and --after, one of the two")
        finger, screen = profiles(self.finger, str(self.profile))
        about = described(finger, screen)
        if self.folder is None:
            return self._by_current(ContactModel(finger, screen), about)
        predictor = StrokePredictor(ContactModel(finger, screen))
        checked = check_profile(reduce_folder(self.folder), predictor)
        days = _days_between(screen, self.folder)
        measured = Session.open(self.folder).info.screen.name
        if measured != screen.name:
            context.tell(
                step=f"the strokes are of screen {measured!r}, the profile is of {screen.name!r}: "
                "agreement means that both feel alike, and no drift is known"
            )
        document = {
            "verdict": checked.verdict,
            "measured_screen": measured,
            "days": days,
            "drift": record(checked.drifts),
            "strokes": record(checked.strokes),
            **about,
        }
        since = "" if days is None else f", {days} days after its calibration"
        rows = [
            {"": name.replace("_", " "), **row(drift)} for name, drift in checked.drifts.items()
        ]
        of = "" if measured == screen.name else f", by strokes on {measured}"
        title = f"{first_line(about)}\n{checked.verdict}: {screen.name}{of}{since}; drift in JND"
        return Result(document, [(title, rows)], failed=not checked.passed)

    def _by_current(self, model: ContactModel, about: dict[str, Any]) -> Result:
        """Compare the current of one person's finger then and now."""
        from haptix.model.pair import first_line
        from haptix.play.sensing import ContactCurrent, EnrolledFinger, contact_change

        before, after = (EnrolledFinger.load(file) for file in (self.before, self.after) if file)
        for person in (before, after):
            if person.screen != model.screen.name:
                raise InputError(
                    f"expected fingers enrolled on {model.screen.name}, got {person.screen}"
                )
        contact = ContactCurrent.of_model(model, before.frequency_hz)
        change = contact_change(before, after, contact)
        row = {"change": f"{change.log_ratio:+.1%}", "within": f"{2 * change.sd:.1%}"}
        title = f"{first_line(about)}\n{change.verdict}: contact's capacitance, by one finger"
        failed = change.is_changed or not change.is_sure
        document = {"verdict": change.verdict, "change": record(change), **about}
        return Result(document, [(title, [row])], failed=failed)


class MatchScreens(Task, command="calibrate match"):
    """Find the friction that two screens can both give, and the voltages for it.

    screens: difference of the friction at A's voltage under the same fingers, B minus A, with its
    90 % uncertainty; fingers: how far these are apart on the same screen. Without --finger both
    fingers that were measured with the screens are laid on either.
    """

    a: Annotated[FileThere, Argument] = Field(description="screen.toml of the first screen.")
    b: Annotated[FileThere, Argument] = Field(description="screen.toml of the second one.")
    normal_force_n: tuple[Positive, ...] = Field(
        (0.2, 0.5, 0.8), description="Normal forces; may be repeated."
    )
    frequency_hz: Positive = Field(DEFAULT_CARRIER_HZ, description="Of the drive.")
    levels: Annotated[int, Field(ge=2, le=1000)] = Field(
        5, description="Frictions in the common range."
    )
    finger: tuple[FingerName, ...] = Field(
        (),
        description="Finger: a preset or a file; may be repeated, for a population. [default: "
        "finger.toml beside each profile]",
    )

    def run(self, context: Context) -> Result:
        """Match them."""
        from calibration.keep.profile import match_screens
        from haptix.model.pair import described, first_line, profiles

        named: tuple[str | None, ...] = self.finger or (None,)
        pairs = [profiles(name, str(file)) for name in named for file in (self.a, self.b)]
        fingers, (a, b) = [finger for finger, _ in pairs], [screen for _, screen in pairs[:2]]
        if self.finger or fingers[0] == fingers[1]:
            fingers = fingers[::2]
        matches = match_screens(a, b, fingers, self.normal_force_n, self.frequency_hz, self.levels)
        about = [described(*pair) for pair in pairs]
        first = "\n".join(map(first_line, about))
        titles = [f"at {match.normal_force_n:g} N and {self.frequency_hz:g} Hz: {match.text}"
                  for match in matches]  # fmt: skip
        titles[0] = f"{first}\n{titles[0]}"
        tables = [(title, match.levels) for title, match in zip(titles, matches, strict=True)]
        return Result([{**record(match), "profiles": about} for match in matches], tables)


class Install(Task, command="calibrate install"):
    """Install a profile for a driver, by whose serial number `haptix render` and `play` find it."""

    profile: Annotated[FileThere, Argument] = Field(
        description="screen.toml of a calibration that passed."
    )
    serial: Text | None = Field(None, description="Serial number of the driver.")
    device: Address | None = Field(None, description="The driver itself, such as usb:.")
    finger: FileThere | None = Field(
        None, description="Finger. [default: finger.toml beside the profile]"
    )

    def run(self, context: Context) -> Result:
        """Install it."""
        from firmware_io import open_device
        from haptix.model.screen import Screen
        from haptix.play.devices import install_profile

        if (self.serial is None) == (self.device is None):
            raise InputError("expected --serial or --device, one of the two")
        serial, is_mock = self.serial, False
        if self.device is not None:
            with closing(open_device(self.device)) as opened:
                serial, is_mock = opened.capabilities.serial, opened.mock is not None
        finger = self.finger or self.profile.with_name("finger.toml")
        installed = install_profile(serial or "", self.profile, finger, is_mock)
        shown = {
            "serial": serial,
            "calibration_id": Screen.load(installed.screen).calibration_id,
            "screen": str(installed.screen),
            "finger": str(installed.finger),
        }
        return Result([shown], [("installed", [shown])])


class Period(Task, command="calibrate period"):
    """Find the spatial period of the touched surface, with its significance and its harmonic.

    Every mapped column but time, place, normal force and drive is a signal; of a session's stroke
    it is the tangential force. Exit code 1 if a file shows no significant period.
    """

    files: Annotated[tuple[FileThere, ...], Field(min_length=1), Argument] = Field(
        description="Recordings: CSV files, or a session's stroke-001.h5."
    )
    columns: FileThere | None = Field(None, description="For CSV: column map, as TOML.")
    speed_mm_per_s: Positive | None = Field(
        None, description="Of the slide, in place of that in the column map."
    )
    shortest_mm: Positive = Field(1.0, description="Shortest period.")
    longest_mm: Positive = Field(6.0, description="Longest period.")

    def run(self, context: Context) -> Result:
        """Find it."""
        from calibration.measure.segmentation import spatial_period

        periods = [
            spatial_period(*self.signals(file), self.shortest_mm, self.longest_mm)
            for file in self.files
        ]
        names = [{"file": file.name} for file in self.files]
        rows = [name | record(period) for name, period in zip(names, periods, strict=True)]
        shown = [
            name | row(period, ("summary",)) for name, period in zip(names, periods, strict=True)
        ]
        is_sure = all(period.is_significant for period in periods)
        return Result(rows, [("spatial period", shown)], failed=not is_sure)

    def signals(self, file: Path) -> tuple[Array, Array, Array]:
        """Return times, places and signals of a recording."""
        import numpy as np

        if file.suffix == ".h5":
            from calibration.measure.recording import StrokeRecording

            stroke = StrokeRecording.load(file)
            return stroke.t_s, stroke.x_mm, stroke.tangential_force_n
        from calibration.measure.columns import ColumnMap, CsvColumn

        if self.columns is None:
            raise InputError(f"--columns: expected a column map, to read {file}")
        columns = ColumnMap.load(self.columns)
        if self.speed_mm_per_s is not None:
            x_mm = CsvColumn(speed_mm_per_s=self.speed_mm_per_s)
            columns = columns.replace(columns={**columns.columns, "x_mm": x_mm})
        if "x_mm" not in columns.columns:
            raise InputError("--speed-mm-per-s: expected a speed, or x_mm in the column map")
        read = columns.read(file)
        known = ("t_s", "x_mm", "normal_force_n", "drive_v")
        signals = [column for name, column in read.items() if name not in known]
        if not signals:
            raise InputError(f"{self.columns}: expected a signal beside time and place")
        return read["t_s"], read["x_mm"], np.stack(signals, axis=-1)


def _days_between(screen: Screen, folder: Path) -> int | None:
    """Days from a calibration to the strokes of a session."""
    from datetime import date

    from calibration.measure.session import Session

    started = min(
        (recording.conditions.started for recording in Session.open(folder).recordings), default=""
    )
    if screen.calibration is None or not started:
        return None
    return (date.fromisoformat(started[:10]) - screen.calibration.date).days
