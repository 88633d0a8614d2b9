"""``haptix plan``."""

import json

import pytest


@pytest.fixture
def scene_file(plain, tmp_path):
    path = tmp_path / "scene.toml"
    plain.save(path)
    return path


def test_a_table_and_the_same_as_json(haptix_cli, scene_file, plain_plan, monkeypatch):
    # Planning itself: test_plans.py, and the scene that test_kept_files.py plans by this command.
    monkeypatch.setattr("haptix.plan.planning.plan_scene", lambda scene, on_progress: plain_plan)
    table = haptix_cli("plan", scene_file)
    assert table.code == 0
    assert max(map(len, table.out.splitlines())) <= 80
    rows = json.loads(haptix_cli("plan", scene_file, "--json").out)
    assert [row["decision"] for row in rows if row["name"] == "apparent-area"] == ["dropped"]
    for row in rows:
        assert row["name"].split()[0] in table.out  # the rest may be in the next line
        assert row["decision"] in ("kept", "dropped")
        assert row["cost_s"] >= 0
        assert row["why"]
