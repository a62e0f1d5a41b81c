"""Logs spread over the processes of a cluster give what one process gives, also when one of them dies."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from echelon.errors import InputError
from echelon.identification.cluster import connect
from echelon.identification.distributed import each, tree
from echelon.identification.identify import identify
from echelon.identification.result import Identification
from swinging import pendulum, write_logs
from test_streaming import same

pytest.importorskip("distributed")
if TYPE_CHECKING:
    from distributed import Client

LOGS = 12


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs")
    write_logs(path, LOGS)
    return path


@pytest.fixture(scope="module")
def alone(folder: Path) -> Identification:
    return identify(pendulum(), [folder])


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> Iterator[Client]:
    # workers must find the modules of the tests, as they find the library
    here = str(Path(__file__).parent)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([here, os.environ.get("PYTHONPATH", "")]))
    with connect("2") as client:
        yield client


def test_two_processes_say_what_one_says(client: Client, folder: Path, alone: Identification) -> None:
    same(identify(pendulum(), [folder], client=client), alone)


def test_forty_logs_and_more_are_merged_in_a_tree(client: Client, folder: Path) -> None:
    """From so many logs on R-factors are merged where they were made; the result is that of one process."""
    logs = [folder] * 4
    same(
        identify(pendulum(), logs, [folder / "run0.parquet"], client=client),
        identify(pendulum(), logs, [folder / "run0.parquet"]),
    )


def _slowly(pause: float, item: int) -> tuple[int, int]:
    time.sleep(pause)
    return item, os.getpid()


def test_a_worker_dies_midway(client: Client, folder: Path, alone: Identification) -> None:
    """What it had made is made again by others."""
    pids = set(client.run(os.getpid).values())
    assert len(pids) == 2
    killed: list[int] = []
    started = threading.Event()

    def kill_one() -> None:
        started.wait(30)
        while not killed:
            # a worker that holds results and is at work
            busy = {address for address, keys in client.processing().items() if keys}
            holding = {address for address, keys in client.has_what().items() if len(keys) > 1}
            for address in busy & holding:
                victim = client.run(os.getpid, workers=[address])[address]
                os.kill(victim, signal.SIGKILL)
                killed.append(victim)
                return
            time.sleep(0.005)

    killer = threading.Thread(target=kill_one)
    killer.start()
    found = identify(
        pendulum(), [folder], client=client, on_step=lambda text: started.set() if "taking" in text else None
    )
    started.set()
    killer.join(30)
    assert killed
    assert killed[0] in pids
    same(found, alone)


def test_results_come_in_order_though_a_worker_dies(client: Client) -> None:
    def kill() -> None:
        time.sleep(0.4)
        os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    found = list(each(client, _slowly, 0.08, range(20)))
    killer.join()
    assert [item for item, _ in found] == list(range(20))
    assert len({pid for _, pid in found}) >= 2


def test_errors_of_a_log_arrive(client: Client, folder: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.parquet"
    broken.write_bytes((folder / "run1.parquet").read_bytes()[:5000])
    with pytest.raises(InputError, match="broken"):
        identify(pendulum(), [folder, broken], client=client)


@pytest.mark.parametrize(
    "where", ["somewhere://127.0.0.1:1", pytest.param("tcp://127.0.0.1:1", marks=pytest.mark.slow)]
)
def test_no_scheduler_there(where: str) -> None:
    with pytest.raises(InputError, match="cannot be reached"), connect(where):
        pass


@pytest.mark.parametrize("count", [1, 2, 3, 8, 13])
def test_trees_keep_the_order_and_are_flat(count: int) -> None:
    depth = 0

    def merge(a: Any, b: Any) -> Any:
        nonlocal depth
        found = (a[0] + b[0], max(a[1], b[1]) + 1)
        depth = max(depth, found[1])
        return found

    items = [(f"{k},", 0) for k in range(count)]
    assert tree(iter(items), merge)[0] == "".join(text for text, _ in items)
    assert depth <= (count - 1).bit_length()
