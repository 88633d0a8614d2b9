"""``haptix calibrate`` and ``python -m calibration``: the commands, in the order of their use."""

from __future__ import annotations

import typer

from calibration import fitting_app, measuring_app, profile_app, rig_app, run_app
from haptix.terminal import run

app = typer.Typer(
    name="calibrate",
    help="Calibrate a screen: plan, measure, reduce, fit, verify; each step can be repeated.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

app.command("plan")(measuring_app.plan)
app.command("measure")(measuring_app.measure)
app.command("reduce")(fitting_app.reduce)
app.command("fit")(fitting_app.fit)
app.command("verify")(fitting_app.verify)
app.command("run")(run_app.run)
app.command("rig")(rig_app.rig)
app.command("check")(profile_app.check)
app.command("match")(profile_app.match)
app.command("install")(profile_app.install)
app.command("period")(profile_app.period)


def main() -> None:
    """Run the steps as a program."""
    run(app, "calibration")
