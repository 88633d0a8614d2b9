"""A task of somebody's own, in one file; and that file put where haptix finds its tasks."""

import os

from haptix.base import task_list
from haptix.tasks import cli

ONE_FILE = '''
"""A task of somebody's own."""

from pydantic import Field

from haptix.base.task import Context, Result, Task
from haptix.base.fields import FileThere, NotNegative


class Charge(Task, command="charge", route="charges"):
    """Charge of a capacitor at some voltages."""

    voltage_v: tuple[NotNegative, ...] = Field(description="Amplitudes.")
    width_mm: float = Field(10.0, gt=0, description="Width of a square electrode.")
    notes: FileThere | None = Field(None, description="What was measured.")

    def run(self, context: Context) -> Result:
        """Compute it."""
        context.progress("charge", 0.5)
        area_m2 = (self.width_mm / 1e3) ** 2
        rows = [{"voltage_v": one, "charge_c": 1e-6 * area_m2 * one} for one in self.voltage_v]
        table = "voltage_v,charge_c\\n" + "".join(
            f"{row['voltage_v']:g},{row['charge_c']:g}\\n" for row in rows
        )
        document = {"rows": rows, "last_c": rows[-1]["charge_c"]}
        return Result(document, [("charge", rows)], files={"charges.csv": table})
'''
ROW = ("charging:Charge", "Charge of a capacitor at some voltages.")
LISTED = f"from haptix.base import task_list\ntask_list.TASKS['charge'] = {ROW!r}\n"


def put_in(folder, monkeypatch):
    """Write the file into a folder, and list it here and in the processes that begin from now on.

    A task of haptix has its row in `haptix/base/task_list.py`.
    """
    (folder / "charging.py").write_text(ONE_FILE)
    (folder / "sitecustomize.py").write_text(LISTED)
    paths = [str(folder), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setitem(task_list.TASKS, "charge", ROW)
    monkeypatch.setitem(cli.COMMANDS, "charge", ROW)
