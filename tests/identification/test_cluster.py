"""Clusters: nobody else connects to a local one; one that is lost or of another version is a clear error."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import urlopen

import distributed
import pytest

from echelon.identification import cluster
from echelon.identification.cluster import connect, each, versions
from echelon.shared.errors import InputError
from support.paths import TESTS

HERE = TESTS
SCHEDULER = """
import asyncio, sys
from distributed import Scheduler
async def main():
    async with Scheduler(host="127.0.0.1", port=int(sys.argv[1]), dashboard_address=":0") as scheduler:
        print(scheduler.address, flush=True)
        await scheduler.finished()
asyncio.run(main())
"""
WORKER = """
import asyncio, sys
if sys.argv[2] == "missing":
    sys.modules["echelon"] = None
elif sys.argv[2]:
    import echelon.shared.version
    echelon.shared.version.__version__ = sys.argv[2]
from distributed import Worker
async def main():
    async with Worker(sys.argv[1], nthreads=1, dashboard_address=":0") as worker:
        print(worker.address, flush=True)
        await worker.finished()
asyncio.run(main())
"""
Start = Callable[..., tuple[subprocess.Popen[str], str]]


def _slowly(pause: float, item: int) -> int:
    time.sleep(pause)
    return item


@pytest.fixture
def start() -> Iterator[Start]:
    """Start a process of a cluster; returns it and its address."""
    running: list[subprocess.Popen[str]] = []

    def started(script: str, *arguments: object) -> tuple[subprocess.Popen[str], str]:
        path = os.pathsep.join([str(HERE), str(HERE.parent / "src")])
        process = subprocess.Popen(
            [sys.executable, "-c", script, *map(str, arguments)],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env={**os.environ, "PYTHONPATH": path},
        )  # fmt: skip
        running.append(process)
        assert process.stdout is not None
        return process, process.stdout.readline().strip()

    yield started
    for process in running:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "_PATIENCE", 2.0)
    monkeypatch.setattr(cluster, "_LOOK", 0.5)


# -- our own -----------------------------------------------------------------------------------------------------------


def test_strangers_cannot_reach_our_own_cluster() -> None:
    """Neither without keys nor with keys of their own; what speaks HTTP says nothing."""
    with connect("1") as client:
        address = client.scheduler.address
        assert address.startswith("tls://127.0.0.1:")
        for stranger in (
            {"address": address.replace("tls", "tcp")},
            {"address": address, "security": distributed.Security.temporary()},
        ):
            with pytest.raises((OSError, ValueError)):
                distributed.Client(**stranger, timeout=1)
        info: dict[str, Any] = client.scheduler_info()
        ports = [
            info["services"].get("dashboard"),
            *(w["services"].get("dashboard") for w in info["workers"].values()),
        ]
        for port in filter(None, ports):
            for page in (
                "",
                "info/main/workers.html",
                "json/identity.json",
                "metrics",
                "health",
            ):
                with pytest.raises(HTTPError, match="404"):
                    urlopen(f"http://127.0.0.1:{port}/{page}", timeout=60)
        folder = next(iter(info["workers"].values()))["local_directory"]
        private = next(
            path for path in Path(folder).parents if path.name.startswith("echelon-")
        )
        assert stat.S_IMODE(private.stat().st_mode) == 0o700
        assert list(each(client, _echo, "common", range(3))) == [
            "common 0",
            "common 1",
            "common 2",
        ]
    assert not private.exists()


def _echo(common: str, item: int) -> str:
    return f"{common} {item}"


@pytest.mark.parametrize("where", ["0", "²", "nowhere", "somewhere://127.0.0.1:1"])
def test_what_is_no_cluster_is_refused(where: str) -> None:
    with pytest.raises(InputError), connect(where):
        pass


# -- lost ones ---------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("impatient")
@pytest.mark.slow
def test_a_cluster_that_loses_all_workers_is_an_error(start: Start) -> None:
    _, address = start(SCHEDULER, 0)
    workers = [start(WORKER, address, "")[0] for _ in range(2)]
    with connect(address) as client:
        results = each(client, _slowly, 0.2, range(100))
        assert next(results) == 0
        for worker in workers:
            worker.kill()
        with pytest.raises(InputError, match="has had no worker for 2 s"):
            list(results)


@pytest.mark.usefixtures("impatient")
def test_a_cluster_without_workers_is_an_error(start: Start) -> None:
    _, address = start(SCHEDULER, 0)
    with connect(address) as client, pytest.raises(InputError, match="no worker"):
        list(each(client, _slowly, 0, range(3)))


def test_patience_ends_within_half_a_minute() -> None:
    assert cluster._PATIENCE + 2 * cluster._LOOK < 30


@pytest.mark.slow
def test_a_scheduler_that_is_started_anew_is_an_error_and_then_serves_again(
    start: Start,
) -> None:
    scheduler, address = start(SCHEDULER, 0)
    start(WORKER, address, "")
    with suppress(OSError), connect(address) as client:
        results = each(client, _slowly, 0.1, range(100))
        assert next(results) == 0
        scheduler.kill()
        scheduler.wait()
        assert start(SCHEDULER, address.rpartition(":")[2])[1] == address
        with pytest.raises(InputError, match="connection to the scheduler was lost"):
            list(results)
    start(WORKER, address, "")
    with connect(address) as client:
        assert list(each(client, _slowly, 0, range(5))) == list(range(5))


# -- versions ----------------------------------------------------------------------------------------------------------


def test_workers_of_another_version_are_refused(start: Start) -> None:
    _, address = start(SCHEDULER, 0)
    start(WORKER, address, "")
    start(WORKER, address, "0.0.1")
    refused = pytest.raises(
        InputError,
        match=rf"it has echelon 0\.0\.1; .* only with {versions()['echelon']}",
    )
    with refused, connect(address):
        pass


def test_a_machine_without_echelon_is_refused(start: Start) -> None:
    _, address = start(SCHEDULER, 0)
    start(WORKER, address, "missing")
    with pytest.raises(InputError, match="it has no echelon"), connect(address):
        pass


@pytest.mark.slow
def test_also_those_that_come_later(start: Start) -> None:
    _, address = start(SCHEDULER, 0)
    with connect(address) as client:
        start(WORKER, address, "0.0.1")
        with pytest.raises(InputError, match=r"it has echelon 0\.0\.1"):
            list(each(client, _slowly, 0, range(3)))


@pytest.mark.parametrize(("name", "found"), [("python", "3.2"), ("numpy", None)])
def test_what_differs_is_named(name: str, found: str | None) -> None:
    with pytest.raises(
        InputError,
        match=f"worker: it has {f'{name} {found}' if found else f'no {name}'}",
    ):
        cluster.check_versions(versions(), {**versions(), name: found}, "worker")
