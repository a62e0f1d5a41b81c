"""Logs spread over the processes of a cluster give what one process gives, also when one of them dies."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from echelon.identification.cluster import connect, each, tree
from echelon.identification.identifying import identify
from echelon.identification.result import Identification
from echelon.identification.saved.identified import identification_to_json
from echelon.shared.errors import InputError
from support.paths import TESTS
from support.pendulum_logs import pendulum, write_logs

if TYPE_CHECKING:
    from distributed import Client

LOGS = 8


def same(a: Identification, b: Identification) -> None:
    """Two identifications agree to the last bit."""
    assert identification_to_json(a) == identification_to_json(b)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs")
    write_logs(path, LOGS)
    return path


@pytest.fixture(scope="module")
def alone(folder: Path) -> Identification:
    return identify(pendulum(), [folder])


@contextmanager
def workers() -> Iterator[Client]:
    """Two of them, who find the modules of the tests as they find the library."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(
            "PYTHONPATH",
            os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")]),
        )
        with connect("2") as client:
            yield client


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    with workers() as client:
        yield client


@pytest.fixture
def mortal() -> Iterator[Client]:
    """A cluster whose workers may be killed."""
    with workers() as client:
        yield client


def test_two_processes_say_what_one_says(
    client: Client, folder: Path, alone: Identification
) -> None:
    same(identify(pendulum(), [folder], client=client), alone)


@pytest.mark.parametrize(
    "memory",
    [pytest.param(size, marks=pytest.mark.slow) for size in (0, 300_000, 1 << 28)],
)
def test_some_logs_are_kept_and_some_are_not(
    client: Client, folder: Path, memory: int
) -> None:
    """By what one process would have had memory for; with one log held out in part, and others."""
    logs, other = (
        [folder / f"run{k}.parquet" for k in range(3)],
        [folder / "run7.parquet"],
    )
    for validate in ([], other):
        found = identify(pendulum(), logs, validate, client=client, memory=memory)
        same(found, identify(pendulum(), logs, validate, memory=memory))


@pytest.mark.parametrize(
    "estimator",
    [pytest.param(name, marks=pytest.mark.slow) for name in ("huber", "tls")],
)
def test_other_estimators_say_the_same(
    client: Client, folder: Path, estimator: str
) -> None:
    setup = pendulum()
    setup = setup.with_settings(estimator=estimator)
    same(identify(setup, [folder], client=client), identify(setup, [folder]))


@pytest.mark.slow
def test_forty_logs_and_more_are_merged_in_a_tree(client: Client, folder: Path) -> None:
    """With forty logs or more, workers merge R-factors in a tree; the result is that of one process."""
    logs = [folder] * 6
    same(
        identify(pendulum(), logs, [folder / "run0.parquet"], client=client),
        identify(pendulum(), logs, [folder / "run0.parquet"]),
    )


def _slowly(pause: float, item: int) -> tuple[int, int]:
    time.sleep(pause)
    return item, os.getpid()


@pytest.mark.slow
def test_a_worker_dies_midway(
    mortal: Client, folder: Path, alone: Identification
) -> None:
    """Other workers compute its results again."""
    pids = set(mortal.run(os.getpid).values())
    assert len(pids) == 2
    killed: list[int] = []
    started = threading.Event()

    def kill_one() -> None:
        started.wait(30)
        while not killed:
            # a worker that holds results and is at work
            busy = {address for address, keys in mortal.processing().items() if keys}
            holding = {
                address for address, keys in mortal.has_what().items() if len(keys) > 1
            }
            for address in busy & holding:
                victim = mortal.run(os.getpid, workers=[address])[address]
                os.kill(victim, signal.SIGKILL)
                killed.append(victim)
                return
            time.sleep(0.005)

    killer = threading.Thread(target=kill_one)
    killer.start()
    found = identify(
        pendulum(),
        [folder],
        client=mortal,
        on_step=lambda text: started.set() if "taking" in text else None,
    )
    started.set()
    killer.join(30)
    assert killed
    assert killed[0] in pids
    same(found, alone)


@pytest.mark.slow
def test_results_come_in_order_though_a_worker_dies(mortal: Client) -> None:
    found: list[tuple[int, int]] = []
    pids: set[int] = set()
    for item, pid in each(mortal, _slowly, 0.05, range(40)):
        found.append((item, pid))
        if len(pids) < 2 and len(pids | {pid}) == 2:
            os.kill(pid, signal.SIGKILL)
        pids.add(pid)
    assert [item for item, _ in found] == list(range(40))
    assert len(pids) >= 2


def test_errors_of_a_log_arrive(client: Client, folder: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.parquet"
    broken.write_bytes((folder / "run1.parquet").read_bytes()[:5000])
    with pytest.raises(InputError, match="broken"):
        identify(pendulum(), [folder, broken], client=client)


@pytest.mark.parametrize(
    "where",
    [
        "somewhere://127.0.0.1:1",
        pytest.param("tcp://127.0.0.1:1", marks=pytest.mark.slow),
    ],
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
