"""The REST side keeps what its description promises, whatever is sent (schemathesis)."""

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings

from haptix.service.access import Access
from haptix.service.assets import AssetStore
from haptix.service.front import application
from haptix.service.hub import Hub
from haptix.service.messages import Inventory

PORT = 7421


class StillEngine:
    def tell(self, do, **fields):
        pass


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    folder = tmp_path_factory.mktemp("service")
    access = Access(PORT, folder)
    inventory = Inventory(devices=(), finger="semi-wet", screen="3m-sct3250", kinds=())
    hub = Hub(access, StillEngine(), inventory, "mock:")
    app = application(hub, AssetStore(folder / "assets"))
    return access, app


@pytest.fixture(scope="module")
def description(service):
    return schemathesis.openapi.from_asgi(
        "/v1/openapi.json", service[1], headers={"Host": f"127.0.0.1:{PORT}"}
    )


OPERATIONS = [
    *("GET /v1/server", "POST /v1/pair", "DELETE /v1/pair", "GET /v1/devices", "GET /v1/kinds"),
    *("PUT /v1/assets/{digest}", "GET /v1/assets/{digest}", "GET /v1/schemas/session"),
    "POST /stop",
]


def test_every_operation_is_tried(description):
    found = {found.ok().label for found in description.get_all_operations()}
    assert found == set(OPERATIONS)


@pytest.mark.parametrize("label", OPERATIONS)
def test_every_answer_is_one_that_was_described(label, description, service):
    access, _ = service
    operation = description.find_operation_by_label(label)

    @given(case=operation.as_strategy())
    @settings(
        max_examples=15,
        deadline=None,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    def check(case):
        headers = {"Host": f"127.0.0.1:{PORT}", "Authorization": f"Bearer {access.native}"}
        case.call_and_validate(headers=headers)

    check()
