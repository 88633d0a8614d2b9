"""Campaigns on a Dask cluster: checked workers, the same bytes, and what is left of a lost one."""

from concurrent.futures import BrokenExecutor

import pytest

from haptix.base.errors import HaptixError
from haptix.tasks.campaign import run_campaign
from haptix.tasks.campaign.cluster import DaskWorkers
from tests.tasks.campaign.test_local_campaigns import pages, plan, results  # noqa: F401
from tests.waiting import PATIENCE_S

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def client():
    """Two workers, threads of this process: their messages are those of any cluster."""
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def address_of(client, name):
    workers = client.scheduler_info(n_workers=-1)["workers"]
    return next(at for at, about in workers.items() if about["name"] == name)


def test_a_client_is_an_executor_and_leaves_the_same_bytes(client, tmp_path):
    there = run_campaign(plan(numbers=30, wrong=(4,), file_bytes=9), tmp_path / "a", client)
    run_campaign(plan(numbers=30, wrong=(4,), file_bytes=9), tmp_path / "b")
    assert there.counts["done"] == 29 and there.counts["failed"] == 1
    assert results(tmp_path / "a") == results(tmp_path / "b")


def test_a_worker_of_another_version_is_refused_by_its_name(client, tmp_path, monkeypatch):
    other, real, said = address_of(client, 1), client.run, []

    def run(function, *given, **named):
        answers = real(function, *given, **named)
        return {
            at: {**answer, "torch": "1.0"} if at == other else answer
            for at, answer in answers.items()
        }

    monkeypatch.setattr(client, "run", run)
    workers = DaskWorkers(client, said.append)
    done = run_campaign(plan(numbers=12, seconds=0.01), tmp_path, workers)
    workers.shutdown()
    assert done.counts["done"] == 12
    assert [one for one in said if "worker 1" in one and "torch 1.0 (here" in one] == said
    assert workers.workers == 1 and [*workers.refused] == ["1"]


def test_workers_that_do_not_see_the_folder_are_refused_all(client, tmp_path, monkeypatch):
    real = client.run

    def run(function, where, kind, **named):
        return real(function, f"{where}-elsewhere", kind, **named)

    monkeypatch.setattr(client, "run", run)
    workers = DaskWorkers(client)
    with pytest.raises(HaptixError, match=r"none that may be used \(0: .*campaign\.json"):
        run_campaign(plan(numbers=2), tmp_path, workers)
    workers.shutdown()


def test_what_only_lost_workers_could_do_is_sent_to_others(client, tmp_path):
    """A restriction to a worker that is gone would wait for ever."""
    workers = DaskWorkers(client)
    workers.expect(str(tmp_path))
    gone = frozenset(["tcp://127.0.0.1:1"])
    with workers._lock:  # its own looks at the workers come between these lines otherwise
        good, workers._good = workers._good, dict.fromkeys(gone, 1)
        future = workers.submit(len, "abc")
        workers._good = good
    assert future.result(timeout=PATIENCE_S) == 3  # the next look sends it again
    workers.shutdown()


def test_errors_of_calls_and_killed_workers_are_told_apart(client):
    workers = DaskWorkers(client)
    workers._good = dict.fromkeys(client.scheduler_info(n_workers=-1)["workers"], 1)
    with pytest.raises(ValueError, match="invalid literal"):
        workers.submit(int, "x").result(timeout=PATIENCE_S)

    class KilledWorker(Exception):
        pass

    class Sent:
        status = "error"

        def exception(self):
            return KilledWorker("four times")

    future = workers.submit(len, "abc")
    sent = Sent()
    workers._calls[future] = workers._calls[future]._replace(sent=sent)
    workers._take(future, sent)
    assert isinstance(future.exception(timeout=PATIENCE_S), BrokenExecutor)
    workers.shutdown()


def test_nothing_at_an_address_is_one_sentence():
    with pytest.raises(HaptixError, match="tcp://127"):
        with_short_patience = {"distributed.comm.timeouts.connect": "1s"}
        import dask

        with dask.config.set(with_short_patience):
            DaskWorkers.on("tcp://127.0.0.1:9")
    with pytest.raises(HaptixError, match="--on"):
        DaskWorkers.on("daks")


def test_tls_with_the_cluster_s_certificate_and_nothing_without(tmp_path):
    """As docs/scale.md has it: what Dask's configuration names is used."""
    import dask

    own = distributed.Security.temporary()
    parts = {"ca-file": own.tls_ca_file, "cert": own.tls_client_cert, "key": own.tls_client_key}
    for name, text in parts.items():
        (tmp_path / name).write_text(text)
    paths = {name: str(tmp_path / name) for name in parts}
    known = {
        "distributed.comm.tls.ca-file": paths["ca-file"],
        "distributed.comm.tls.client": {"cert": paths["cert"], "key": paths["key"]},
        "distributed.comm.timeouts.connect": "2s",
    }
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None,
        protocol="tls://", host="127.0.0.1", security=own,
    ) as cluster:  # fmt: skip
        address = cluster.scheduler_address
        assert address.startswith("tls://")
        with dask.config.set(known):
            workers = DaskWorkers.on(address)
        done = run_campaign(plan(numbers=5, file_bytes=9), tmp_path / "out", workers)
        workers.shutdown()
        assert done.counts["done"] == 5
        with (
            dask.config.set({"distributed.comm.timeouts.connect": "2s"}),
            pytest.raises(HaptixError, match="tls://"),
        ):
            DaskWorkers.on(address)
