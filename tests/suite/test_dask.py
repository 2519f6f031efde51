"""The same run on two workers over loopback, inputs sent as bytes, one worker killed."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator, Sequence
from typing import Any

import pytest

pytest.importorskip("distributed", reason="a cluster needs the extra 'dask'")

from distributed import Client, LocalCluster

from physretarget.errors import InputError
from physretarget.suite.dask import distributed, on
from physretarget.suite.file import load_suite
from physretarget.suite.job import Job, Outcome
from physretarget.suite.plan import plan
from physretarget.suite.work import perform

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None,
                     host="127.0.0.1") as cluster,
        Client(cluster) as connected,
    ):  # fmt: skip
        yield connected


def contents(outcomes: Any) -> dict[str, Any]:
    return {o.address: (o.status, o.message, o.document, o.artifacts) for o in outcomes}


def broken_too(library: Any) -> Sequence[Job]:
    library.path("c").write_bytes(b"no clip")
    return plan(load_suite(library.file)).jobs


def test_a_cluster_gives_the_same_as_this_process(library: Any, client: Any) -> None:
    jobs = broken_too(library)
    here = contents(map(perform, jobs))
    assert contents(on(client)(jobs)) == here
    assert [status for status, *_ in here.values()].count("errored") == 1


def test_a_killed_worker_costs_a_retry_only(library: Any, client: Any) -> None:
    # Addresses of their own, so that nothing is remembered from another test.
    for name in "efghijkl":
        library.clip(name)
    jobs = broken_too(library)
    here = contents(map(perform, jobs))
    found: list[Outcome] = []
    for outcome in on(client)(jobs):
        found.append(outcome)
        if len(found) == 2:
            pids = client.run(os.getpid)
            os.kill(next(iter(pids.values())), signal.SIGKILL)
    assert len(found) == len(jobs)
    assert contents(found) == here


def test_nobody_at_the_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("physretarget.suite.dask.PATIENCE_S", 1)
    with (
        pytest.raises(InputError, match="no Dask scheduler"),
        distributed("tcp://127.0.0.1:1", 1),
    ):
        pass
