"""Logs spread over the processes of a Dask cluster: a tree of R-factors.

What travels is a plan, which is small, and R-factors, which are small; never samples.  Merging R-factors is
associative, so every log can be taken in anywhere and the factors be merged pairwise in a tree of logarithmic depth; a
task whose worker died is simply run again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeVar

from echelon.errors import InputError, MissingExtraError
from echelon.observe.observation import Observation

if TYPE_CHECKING:
    from distributed import Client

Item = TypeVar("Item")
Result = TypeVar("Result")


@contextmanager
def connect(where: str) -> Iterator[Client]:
    """A Dask client.

    Parameters
    ----------
    where : str
        Address of a scheduler, such as ``tcp://10.0.0.1:8786``, or a number of processes to start on this machine.

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    InputError
        If the scheduler cannot be reached.
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise MissingExtraError("distributed", "dask") from None
    if where.isdigit():
        with (
            LocalCluster(n_workers=max(int(where), 1), threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster) as client,
        ):
            yield client
        return
    try:
        client = Client(where, timeout="10s")
    except (OSError, ValueError) as error:
        raise InputError(f"the scheduler cannot be reached: {error}", source=where) from None
    with client:
        yield client


def each(client: Client | None, function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Results of a function for all items, in their order; on a cluster, or one after another here.

    Parameters
    ----------
    client : distributed.Client, optional
    function : callable
        Without side effects, because it may run more than once.
    items : iterable
    """
    if client is None:
        yield from map(function, items)
        return
    futures = client.map(function, list(items), pure=False)
    for future in futures:
        yield future.result()


def summed(
    client: Client | None, function: Callable[[Item], Observation], items: Sequence[Item], groups: int
) -> list[Observation]:
    """Observations of all items, merged into so many groups of neighbours.

    Parameters
    ----------
    client : distributed.Client, optional
    function : callable
        Takes in one item.
    items : sequence
    groups : int
        At most so many sums are returned; their own sum is that of all items.
    """
    bounds = [round(k * len(items) / groups) for k in range(groups + 1)]
    parts = [items[low:high] for low, high in pairwise(bounds) if high > low]
    if client is None:
        return [_tree([function(item) for item in part], merged) for part in parts]

    def merge(a: Any, b: Any) -> Any:
        return client.submit(merged, a, b, pure=False)

    trees = [_tree(client.map(function, list(part), pure=False), merge) for part in parts]
    found: list[Observation] = client.gather(trees)
    return found


def merged(a: Observation, b: Observation) -> Observation:
    """The observation of both sets of samples."""
    return a + b


def _tree(values: Sequence[Any], merge: Callable[[Any, Any], Any]) -> Any:
    """Merge neighbours pairwise until one value is left."""
    level = list(values)
    while len(level) > 1:
        pairs = [merge(a, b) for a, b in zip(level[::2], level[1::2], strict=False)]
        level = pairs + level[len(pairs) * 2 :]
    return level[0]
