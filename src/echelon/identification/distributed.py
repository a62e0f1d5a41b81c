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
from echelon.exact.syntax import is_whole
from echelon.identification.rows.batches import Batch, joined

if TYPE_CHECKING:
    from distributed import Client

Common = TypeVar("Common")
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
    if is_whole(where):
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


def each(
    client: Client | None, function: Callable[[Common, Item], Result], common: Common, items: Iterable[Item]
) -> Iterator[Result]:
    """Results of a function for all items, in their order; on a cluster, or one after another here.

    Parameters
    ----------
    client : distributed.Client, optional
    function : callable
        Of ``common`` and an item; without side effects, because it may run more than once.
    common : object
        What every call needs.  It is sent to a worker once, and what a worker compiles for it is used again.
    items : iterable
    """
    if client is None:
        yield from (function(common, item) for item in items)
        return
    futures = _mapped(client, function, common, list(items))
    while futures:
        # a result that was taken need not be kept by its worker
        yield futures.pop(0).result()


def summed(
    client: Client | None,
    function: Callable[[Common, Item], tuple[Batch, ...]],
    common: Common,
    items: Sequence[Item],
    groups: int,
) -> list[tuple[Batch, ...]]:
    """Batches of all items, merged into so many groups of neighbours.

    Parameters
    ----------
    client : distributed.Client, optional
    function : callable
        Takes in one item; see :func:`each`.
    common : object
        What every call needs.
    items : sequence
    groups : int
        At most so many sums are returned; their own sum is that of all items.
    """
    bounds = [round(k * len(items) / groups) for k in range(groups + 1)]
    parts = [items[low:high] for low, high in pairwise(bounds) if high > low]
    if client is None:
        return [tree((function(common, item) for item in part), joined) for part in parts]

    def merge(a: Any, b: Any) -> Any:
        return client.submit(joined, a, b, pure=False)

    trees = [tree(_mapped(client, function, common, part), merge) for part in parts]
    found: list[tuple[Batch, ...]] = client.gather(trees)
    return found


def tree(values: Iterable[Any], merge: Callable[[Any, Any], Any]) -> Any:
    """Merge neighbours pairwise until one value is left, holding no more values than the tree is deep.

    Parameters
    ----------
    values : iterable
        At least one.
    merge : callable
        Associative.

    Examples
    --------
    >>> tree("abcde", lambda a, b: f"({a}{b})")
    '(((ab)(cd))e)'
    """
    waiting: list[tuple[int, Any]] = []  # how many values were merged into it, a power of two; descending
    for value in values:
        size = 1
        while waiting and waiting[-1][0] == size:
            value, size = merge(waiting.pop()[1], value), 2 * size
        waiting.append((size, value))
    result = waiting.pop()[1]
    while waiting:
        result = merge(waiting.pop()[1], result)
    return result


def _mapped(client: Client, function: Callable[..., Any], common: object, items: Sequence[Any]) -> list[Any]:
    # the result of a task can be made again if the worker that holds it dies; data that were only sent could not
    shared = client.submit(_itself, common, pure=False)
    return list(client.map(function, [shared] * len(items), items, pure=False))


def _itself(value: Item) -> Item:
    return value
