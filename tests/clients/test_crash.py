"""Apps that are killed and started again are felt again at once, in each language."""

import os
import subprocess
import sys

import pytest

from tests.clients.compiled import compiled
from tests.made_clients import TYPESCRIPT, node_tools
from tests.waiting import wait_for

PYTHON = """
import sys
import haptix
h = haptix.service.connect("kiosk")
h.layout.add({"kind": "grating", "period_mm": 2}, width_mm=80, height_mm=50)
h.acquire()
h.arm()
print("armed", flush=True)
sys.stdin.read()
"""
NODE = """
import { connect } from "haptix-client";
import { find } from "haptix-client/node";
import { WebSocket } from "ws";
const h = await connect({ name: "kiosk", find, WebSocket });
await h.layout.add({ kind: "grating", period_mm: 2 }, { width_mm: 80, height_mm: 50 });
await h.acquire();
await h.arm();
console.log("armed");
"""
MONO = """
using System;
using Haptix;
using Haptix.Materials;
static class Kiosk
{
    static void Main()
    {
        Session h = Session.Connect("kiosk").Result;
        h.Layout.Add(new Grating { PeriodMm = 2 }, widthMm: 80, heightMm: 50).Wait();
        h.Acquire().Wait();
        h.Arm().Wait();
        Console.WriteLine("armed");
        Console.ReadLine();
    }
}
"""


def python_app(folder):
    (folder / "app.py").write_text(PYTHON)
    return [sys.executable, folder / "app.py"]


def node_app(folder):
    (folder / "node_modules").mkdir()
    (folder / "node_modules" / "haptix-client").symlink_to(TYPESCRIPT)
    (folder / "node_modules" / "ws").symlink_to(node_tools() / "ws")
    (folder / "app.mjs").write_text(NODE)
    return ["node", folder / "app.mjs"]


def mono_app(folder):
    (folder / "source").mkdir()
    (folder / "source" / "App.cs").write_text(MONO)
    return ["mono", compiled(folder / "App.exe", folder / "source")]


@pytest.mark.parametrize("app", [python_app, node_app, mono_app])
def test_a_killed_app_has_its_lease_back_with_an_empty_layout(service, app, tmp_path):
    environment = os.environ | {"HAPTIX_SERVICE": str(service.access.folder)}
    command = app(tmp_path)
    armed = []
    for _ in range(2):
        service.engine.told.clear()
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        ) as process:
            assert process.stdout.readline() == "armed\n"
            armed.append(service.hub.control.holder)
            process.kill()
        wait_for(lambda: service.hub.control.holder is None)
    first, second = armed
    assert first.app == second.app and first.layout != second.layout
    assert ("forget", {"session": first.layout}) in [one[:2] for one in service.engine.told]
