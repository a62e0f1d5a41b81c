"""A Dask cluster to work on, and logs spread over its processes.

The cluster is one that is there, or processes of this machine that only their user can reach.  Whoever can connect to a
scheduler can run code as the user who started it, and loopback is open to all users of a machine.  So a cluster of our
own speaks TLS with keys that are made for it, never leave its processes, and are asked for on both sides.

What travels is a plan, which is small, and R-factors, which are small; never samples.  Merging R-factors is
associative, so every log can be taken in anywhere and the factors be merged pairwise in a tree of logarithmic depth; a
task whose worker died is simply run again.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from tempfile import TemporaryDirectory
from time import monotonic
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from echelon.algebra import is_whole
from echelon.shared import InputError, __version__, extra

if TYPE_CHECKING:
    from distributed import Client, Future

_PATIENCE = (
    15.0  # seconds without a single worker after which none is expected to come (back)
)
_LOOK = 5.0  # seconds between two looks whether there are workers: results are small and travel faster
_SILENT: dict[str, list[str]] = {
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
"""No pages about what the processes do."""


@contextmanager
def connect(where: str) -> Iterator[Client]:
    """A Dask client."""
    with extra("dask"):
        from distributed import Client
    if is_whole(where):
        with _own_cluster(int(where)) as cluster, Client(cluster) as client:
            yield client
        return
    try:
        client = Client(where, timeout="10s")
    except (OSError, ValueError) as error:
        raise InputError(
            f"the scheduler cannot be reached: {error}", source=where
        ) from None
    with client:
        _check_versions(client, where)
        yield client


@contextmanager
def _own_cluster(count: int) -> Iterator[Any]:
    """Processes of this machine."""
    with extra("dask"):
        import cryptography  # noqa: F401  # which certificates are made with
        import dask
        from distributed import LocalCluster, Security

    if not count:
        raise InputError(
            "0 processes cannot work; expected at least 1, or the address of a scheduler"
        )
    security = Security.temporary()
    with (
        TemporaryDirectory(prefix="echelon-") as folder,
        dask.config.set(_SILENT),
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            protocol="tls://",
            security=security,
            local_directory=folder,
        ) as cluster,
    ):
        yield cluster


# -- versions ----------------------------------------------------------------------------------------------------------


def versions() -> dict[str, str]:
    """Versions that have to be the same everywhere, so that results are."""
    return {
        "echelon": __version__,
        "python": ".".join(map(str, sys.version_info[:2])),
        "numpy": np.__version__,
    }


def check_versions(
    wanted: Mapping[str, str], found: Mapping[str, str | None], who: str
) -> None:
    """Compare the versions of a process with those of the one that asks for work."""
    for name, version in wanted.items():
        other = found.get(name)
        if other != version:
            has = f"no {name}" if other is None else f"{name} {other}"
            raise InputError(
                f"it has {has}; results are the same only with {version}, as used here",
                source=who,
            )


def _check_versions(client: Client, where: str) -> None:
    """Compare the versions of the scheduler and all workers; one that cannot import this module has no Echelon."""
    found: dict[str, Any] = client.run(versions, on_error="return")
    try:
        found[f"scheduler {where}"] = client.run_on_scheduler(versions)
    except Exception as error:  # whatever it was that the scheduler could not do
        found[f"scheduler {where}"] = error
    for who, answer in found.items():
        check_versions(versions(), answer if isinstance(answer, dict) else {}, who)


# -- results -----------------------------------------------------------------------------------------------------------


def result(client: Client, future: Future[Any]) -> Any:
    """Result of a task, waited for while there is anyone to work on it."""
    from concurrent.futures import CancelledError

    with extra("dask"):
        from distributed import KilledWorker
        from distributed.comm.core import CommClosedError

    address, seen = str(client.scheduler_info().get("address")), monotonic()
    while True:
        try:
            # also one that was made may be lost before it is here
            return future.result(timeout=_LOOK)
        except KilledWorker as error:
            problem = f"a task ended {error.allowed_failures + 1} workers one after another, perhaps by lack of memory"
            raise InputError(problem, source=address) from None
        except (CancelledError, CommClosedError):
            raise InputError(
                "the connection to the scheduler was lost; run this again",
                source=address,
            ) from None
        except TimeoutError:
            if future.status == "error":
                raise
        if client.status != "running" or client.scheduler_info()["workers"]:
            seen = monotonic()
        elif monotonic() - seen > _PATIENCE:
            problem = f"the cluster has had no worker for {_PATIENCE:.0f} s; start some and run this again"
            raise InputError(problem, source=address)


Common = TypeVar("Common")
Item = TypeVar("Item")
Result = TypeVar("Result")


def each(
    client: Client | None,
    function: Callable[[Common, Item], Result],
    common: Common,
    items: Iterable[Item],
) -> Iterator[Result]:
    """Results of a function for all items, in their order; on a cluster, or one after another here."""
    if client is None:
        yield from (function(common, item) for item in items)
        return
    futures = _mapped(client, function, common, list(items))
    while futures:
        # a result that was taken need not be kept by its worker
        yield result(client, futures.pop(0))


def summed(
    client: Client | None,
    function: Callable[[Common, Item], Result],
    merge: Callable[[Result, Result], Result],
    common: Common,
    items: Sequence[Item],
    groups: int,
) -> list[Result]:
    """Results of a function for all items, merged into ``groups`` groups of neighbours."""
    bounds = [round(k * len(items) / groups) for k in range(groups + 1)]
    parts = [items[low:high] for low, high in pairwise(bounds) if high > low]
    if client is None:
        return [
            tree((function(common, item) for item in part), merge) for part in parts
        ]
    there = partial(client.submit, merge, pure=False)
    trees = [tree(_mapped(client, function, common, part), there) for part in parts]
    return [result(client, future) for future in trees]


def tree(values: Iterable[Any], merge: Callable[[Any, Any], Any]) -> Any:
    """Merge neighbours pairwise until one value is left, holding no more values than the tree is deep."""
    # how many values were merged into it, a power of two; descending
    waiting: list[tuple[int, Any]] = []
    for value in values:
        size = 1
        while waiting and waiting[-1][0] == size:
            value, size = merge(waiting.pop()[1], value), 2 * size
        waiting.append((size, value))
    result = waiting.pop()[1]
    while waiting:
        result = merge(waiting.pop()[1], result)
    return result


def _mapped(
    client: Client, function: Callable[..., Any], common: object, items: Sequence[Any]
) -> list[Any]:
    # the result of a task can be made again if the worker that holds it dies; data that were only sent could not
    shared = client.submit(_itself, common, pure=False)
    return list(
        client.map(
            partial(_checked, versions(), function),
            [shared] * len(items),
            items,
            pure=False,
        )
    )


def _checked(
    expected: dict[str, str],
    function: Callable[[Common, Item], Result],
    common: Common,
    item: Item,
) -> Result:
    """The function, by a worker that may have come later than others."""
    with extra("dask"):
        from distributed import get_worker

    check_versions(expected, versions(), f"worker {get_worker().address}")
    return function(common, item)


def _itself(value: Item) -> Item:
    return value
