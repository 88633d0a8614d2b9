"""The REST side keeps what its description promises, whatever is sent (schemathesis)."""

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis.specs.openapi.checks import positive_data_acceptance

from haptix import Finger, Screen
from haptix.base.task import all_tasks
from haptix.service.front.access import Access
from haptix.service.front.application import application
from haptix.service.front.assets import AssetStore
from haptix.service.front.hub import Hub
from haptix.service.front.jobs import JobBoard
from haptix.service.front.rest import documents_router
from haptix.service.protocol.messages import Inventory, Problem
from haptix.service.worker.document_work import profiles_of
from tests.service.service_under_test import is_reached

PORT = 7421


class StillEngine:
    def tell(self, do, **fields):
        pass


class RefusingPool:
    async def ask(self, owner, do, **fields):
        raise Problem("document", "expected another material")


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    async def waits(_):  # no processes: the queue fills, and then refuses
        pass

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(JobBoard, "_runs", waits)
        yield made(tmp_path_factory)


def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("service")
    access = Access(PORT, folder)
    inventory = Inventory(devices=(), finger="semi-wet", screen="3m-sct3250", kinds=())
    hub = Hub(access, StillEngine(), inventory, "mock:")
    names = {"finger": "semi-wet", "screen": "3m-sct3250"}
    hub.profiles = profiles_of(
        Finger.preset(names["finger"]), Screen.preset(names["screen"]), names
    )
    hub.schema = {"properties": {}}
    hub.jobs.context["calibrations"] = str(folder / "calibrations")
    (folder / "layouts").mkdir()
    documents = documents_router(RefusingPool(), folder / "layouts", is_reached)
    app = application(hub, AssetStore(folder / "assets"), documents=documents)
    return access, app


@pytest.fixture(scope="module")
def description(service):
    return schemathesis.openapi.from_asgi(
        "/v1/openapi.json", service[1], headers={"Host": f"127.0.0.1:{PORT}"}
    )


OPERATIONS = [
    *(
        "GET /v1/server",
        "POST /v1/pair",
        "DELETE /v1/pair",
        "GET /v1/pair/code",
        "GET /v1/devices",
        "GET /v1/kinds",
    ),
    *("PUT /v1/assets/{digest}", "GET /v1/assets/{digest}", "GET /v1/schemas/session"),
    *("GET /v1/person", "PUT /v1/person"),
    *("POST /stop", "GET /v1/profiles/{kind}", "GET /v1/gallery", "GET /v1/layouts"),
    *(f"{method} /v1/layouts/{{name}}" for method in ("GET", "PUT", "DELETE")),
    *("POST /v1/layouts/{name}/rename", "GET /v1/layouts/{name}/versions"),
    *("GET /v1/layouts/{name}/versions/{revision}", "GET /v1/drafts"),
    *(f"{method} /v1/drafts/{{name}}" for method in ("GET", "PUT", "DELETE")),
    *("POST /v1/pictures", "POST /v1/materials/check", "POST /v1/exports"),
    *(f"POST /v1/{task.route}" for task in all_tasks() if task.route),
    *("GET /v1/surfaces", "GET /v1/jobs", "GET /v1/jobs/{job}", "DELETE /v1/jobs/{job}"),
    *("GET /v1/jobs/{job}/files", "GET /v1/jobs/{job}/files/{name}"),
    *("POST /v1/jobs/{job}/answer", "GET /v1/calibrations/{name}/report"),
]


DOCUMENTS = (
    *("PUT /v1/layouts/{name}", "POST /v1/pictures", "POST /v1/materials/check"),
    *("POST /v1/exports", "POST /v1/headroom", "POST /v1/renderings", "POST /v1/experiments"),
)
STALE = (  # a revision that is drawn is none
    *("DELETE /v1/layouts/{name}", "POST /v1/layouts/{name}/rename"),
    *("PUT /v1/drafts/{name}", "DELETE /v1/drafts/{name}"),
)


def test_every_operation_is_tried(description):
    found = {found.ok().label for found in description.get_all_operations()}
    assert found == set(OPERATIONS)


@pytest.mark.parametrize("label", OPERATIONS)
def test_every_answer_is_one_that_was_described(label, description, service):
    access, _ = service
    operation = description.find_operation_by_label(label)

    @given(case=operation.as_strategy())
    @settings(
        max_examples=8,
        deadline=None,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    def check(case):
        headers = {"Host": f"127.0.0.1:{PORT}", "Authorization": f"Bearer {access.native}"}
        # A document is checked by its kind, and for what no file holds: no OpenAPI tells either.
        excluded = [positive_data_acceptance] if label in DOCUMENTS + STALE else []
        case.call_and_validate(headers=headers, excluded_checks=excluded)

    check()
