"""Logs spread over the processes of a Dask cluster: a tree of R-factors.

What travels is a plan, which is small, and R-factors, which are small; never samples.  Merging R-factors is
associative, so every log can be taken in anywhere and the factors be merged pairwise in a tree of logarithmic depth; a
task whose worker died is simply run again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeVar

from echelon.identification.cluster import check_versions, result, versions

if TYPE_CHECKING:
    from distributed import Client

Common = TypeVar("Common")
Item = TypeVar("Item")
Result = TypeVar("Result")


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
        yield result(client, futures.pop(0))


def summed(
    client: Client | None,
    function: Callable[[Common, Item], Result],
    merge: Callable[[Result, Result], Result],
    common: Common,
    items: Sequence[Item],
    groups: int,
) -> list[Result]:
    """Results of a function for all items, merged into so many groups of neighbours.

    Parameters
    ----------
    client : distributed.Client, optional
    function : callable
        Takes in one item; see :func:`each`.
    merge : callable
        Associative; where results are, which need not travel then.
    common : object
        What every call needs.
    items : sequence
    groups : int
        At most so many sums are returned; their own sum is that of all items.
    """
    bounds = [round(k * len(items) / groups) for k in range(groups + 1)]
    parts = [items[low:high] for low, high in pairwise(bounds) if high > low]
    if client is None:
        return [tree((function(common, item) for item in part), merge) for part in parts]
    there = partial(client.submit, merge, pure=False)
    trees = [tree(_mapped(client, function, common, part), there) for part in parts]
    return [result(client, future) for future in trees]


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
    return list(client.map(partial(_checked, versions(), function), [shared] * len(items), items, pure=False))


def _checked(
    expected: dict[str, str], function: Callable[[Common, Item], Result], common: Common, item: Item
) -> Result:
    """The function, by a worker that may have come later than others."""
    from distributed import get_worker

    check_versions(expected, versions(), f"worker {get_worker().address}")
    return function(common, item)


def _itself(value: Item) -> Item:
    return value
