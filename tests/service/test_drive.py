"""What full drive means: told by REST once it is known."""

import httpx
import pytest
from fastapi import Depends, Request

from haptix.service.front.in_use import drive_router
from tests.service.service_under_test import Service

CURRENTS = {"normal_force_n": [0.5, 1.0], "current_a": [9e-5, 1.4e-4]}


class Pool:
    asked = 0

    async def ask(self, owner, do, **fields):
        Pool.asked += 1
        asked = {"carrier_hz": 4000.0, "highest_v": 150.0}
        assert (owner, do, fields) == ("programs", "currents", asked)
        return CURRENTS


def is_a_program(request: Request):
    request.state.owner = "programs"


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    service = Service(tmp_path_factory.mktemp("service"))
    router = drive_router(service.hub, Pool())
    service.app._app.include_router(router, dependencies=[Depends(is_a_program)])
    yield service
    service.close()


def test_volts_are_told_once_the_output_was_armed(service):
    address = f"http://127.0.0.1:{service.port}/v1/drive"
    own = {"Authorization": f"Bearer {service.access.native}"}
    assert httpx.get(address, headers=own).status_code == 409
    service.hub.full_drive = {"carrier_hz": 4000.0, "highest_v": 150.0}
    found = httpx.get(address, headers=own)
    assert found.json() == {"carrier_hz": 4000.0, "highest_v": 150.0, **CURRENTS}
    assert httpx.get(address, headers=own).json() == found.json()
    assert Pool.asked == 1  # a worker takes seconds to find it, and may have died
