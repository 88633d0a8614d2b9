"""A kind that another package brings, in the whole service and the whole studio."""

import json

import pytest

import haptix.service.client.connection
from tests.feel.materials.strangers_kind import installed
from tests.studio.conftest import a_page, a_studio
from tests.waiting import wait_for

pytestmark = pytest.mark.slow  # starts the whole service


def test_a_kind_of_another_package_is_felt_by_the_service_and_edited_in_the_studio(
    tmp_path, browser, monkeypatch
):
    folder = tmp_path / "service"
    (folder / "layouts").mkdir(parents=True)
    region = {"name": "sock", "x_mm": 5.0, "y_mm": 5.0, "width_mm": 40.0, "height_mm": 30.0}
    document = {"regions": [{**region, "material": {"kind": "wool", "loop_mm": 6.0}}]}
    (folder / "layouts" / "wool.json").write_text(json.dumps(document))
    monkeypatch.setenv("HAPTIX_SERVICE", str(folder))
    with a_studio(installed(tmp_path / "stranger")) as address, a_page(browser) as page:
        with haptix.service.client.connection.connect("test") as client:
            assert "wool" in client.ask("inventory").kinds
        page.goto(address)
        page.get_by_role("link", name="Make").click()
        page.locator(".thumb").first.wait_for()
        page.locator("summary", has_text="Layouts").click()
        page.get_by_role("button", name="wool", exact=True).click()
        page.locator('button.region[aria-label^="sock"]').click()
        page.get_by_text("Loops of a thread across the stroke.").wait_for()
        loop = page.get_by_label("Loop", exact=True)
        assert loop.input_value() == "6"
        loop.fill("3")
        loop.press("Enter")
        page.get_by_role("button", name="Keep", exact=True).click()

        def kept_loops():
            versions = (folder / "layouts" / "wool").glob("*.json")
            return [
                json.loads(path.read_text())["regions"][0]["material"]["loop_mm"]
                for path in versions
            ]

        wait_for(lambda: 3 in kept_loops())
