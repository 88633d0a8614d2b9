"""Behind `--listen`: a certificate that was made here, and every client by TLS."""

import os
import shutil
import subprocess

import pytest

import haptix.service.client.connection
from haptix.base.errors import DeviceError
from tests.clients.compiled import compiled
from tests.made_clients import TYPESCRIPT, node_tools
from tests.service.service_under_test import Service, certified
from tests.waiting import PATIENCE_S, wait_for

pytestmark = pytest.mark.slow  # the same clients speak to the front without TLS

NODE = """
import { createRequire } from "node:module";
const [client, url, token] = process.argv.slice(-3);
const { connect } = await import(client + "/src/haptix.js");
const { find } = await import(client + "/src/node.js");
const WebSocket = createRequire(client + "/")("ws");
const h = await connect({ name: "far", url, token, WebSocket });
await h.acquire();
await h.arm();
h.touch({ x_mm: 7, y_mm: 8 });
await h.asset(new Blob(["a photograph"]), ".png");
await h.close();
const near = await connect({ name: "near", find, WebSocket }); // by service.json
await near.close();
"""

MONO = """
using Haptix;
static class Far
{
    static void Main(string[] arguments)
    {
        var service = new Service(arguments[0], arguments[1]);
        using (Session h = Session.Connect("far", () => service).Result)
        {
            h.Acquire().Wait();
            h.Arm().Wait();
            h.Touch(7f, 8f);
            h.Asset(arguments[2]).Wait();
        }
        Session.Connect("near").Result.Dispose(); // by service.json
    }
}
"""


class FarService(Service):
    """A front as `haptix serve --listen localhost` starts it."""

    def __init__(self, folder):
        listen = certified(folder)
        super().__init__(folder / "service", listen=listen)
        self.certificate = listen.certificate
        self.url = f"wss://localhost:{self.port}/v1/session"

    def felt(self):
        """Whether the touch of a client came, and its file."""
        return [report.x_mm for report in self.engine.reports] == [7.0]


@pytest.fixture
def far(tmp_path):
    service = FarService(tmp_path)
    yield service
    service.close()


def test_python(far, monkeypatch):
    with pytest.raises(DeviceError, match="certificate"):
        haptix.service.client.connection.connect("far", far.url, far.access.native)
    monkeypatch.setenv("SSL_CERT_FILE", str(far.certificate))
    monkeypatch.setenv("HAPTIX_SERVICE", str(far.access.folder))
    with haptix.service.client.connection.connect("near") as h:
        assert h.welcome.limits.effects  # a program of the same user finds the service by itself
    with haptix.service.client.connection.connect("far", far.url, far.access.native) as h:
        h.acquire()
        h.arm()
        h.touch(7.0, 8.0)
    wait_for(far.felt)


def test_typescript(far, tmp_path):
    node_tools()
    script = tmp_path / "far.mjs"
    script.write_text(NODE)
    command = ["node", script, TYPESCRIPT, far.url, far.access.native]
    here = os.environ | {"HAPTIX_SERVICE": str(far.access.folder)}
    stranger = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, env=here)
    assert stranger.returncode != 0  # a certificate that nobody vouches for
    trusting = here | {"NODE_EXTRA_CA_CERTS": str(far.certificate)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, env=trusting)
    assert done.returncode == 0, done.stderr
    wait_for(far.felt)


def test_csharp(far, tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    (source / "Far.cs").write_text(MONO)
    program = compiled(tmp_path / "far.exe", source)
    photograph = tmp_path / "photograph.png"
    photograph.write_bytes(b"a photograph")
    home = os.environ | {"HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path / ".config")}
    home["HAPTIX_SERVICE"] = str(far.access.folder)
    command = ["mono", program, far.url, far.access.native, photograph]
    stranger = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, env=home)
    assert stranger.returncode != 0
    # Where `cert-sync --user` of ca-certificates-mono puts what this user trusts.
    trusted = tmp_path / ".config" / ".mono" / "new-certs" / "Trust"
    trusted.mkdir(parents=True)
    naming = ["openssl", "x509", "-noout", "-subject_hash", "-in", far.certificate]
    named = subprocess.run(naming, check=True, capture_output=True, text=True)
    shutil.copy(far.certificate, trusted / f"{named.stdout.strip()}.0")
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, env=home)
    assert done.returncode == 0, done.stdout + done.stderr
    wait_for(far.felt)
