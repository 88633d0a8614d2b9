"""A service whose engine echoes: touches as contacts, streams as one frame."""

import asyncio
import time

import numpy as np
import pytest

from haptix.service.front.hub import Hub
from haptix.service.protocol.batches import TelemetryFrame, write_frame
from tests.service.service_under_test import Service, WrittenEngine


class EchoEngine(WrittenEngine):
    """Answers what clients must pass on, at once."""

    hub: Hub

    async def ask(self, do, **fields):
        if do == "play" and fields["effect"].get("kind") == "slow":
            await asyncio.sleep(1.0)
        if do == "play" and fields["effect"].get("kind") == "cut":
            for session in self.hub.sessions.values():
                session.close(1012, "cut")
        return await super().ask(do, **fields)

    def tell(self, do, **fields):
        super().tell(do, **fields)
        if do == "streams" and fields["rates"].get("stats"):
            rows = np.append(np.arange(7.0), np.nan).reshape(2, 4)
            frame = TelemetryFrame("stats", 2, 1, 0, time.monotonic(), 0.1, rows)
            self.hub.on_telemetry(write_frame(frame))

    def touch(self, reports):
        super().touch(reports)
        for report in reports:
            if report.kind == "down":
                layout = self.hub.control.holder.layout
                event = {"event": "contact", "session": layout, "what": "enter", "region": "ribs"}
                event |= {"touch_id": report.touch_id, "t_s": report.t_s}
                self.hub.on_engine_event(event)


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    service = Service(tmp_path_factory.mktemp("service"))
    service.engine = service.hub.engine = service.hub.control.engine = engine = EchoEngine()
    engine.hub = service.hub
    yield service
    service.close()
