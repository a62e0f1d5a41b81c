"""Reading ahead: the next piece of a log is read and prepared on another thread while this one is worked on.

Decoding, filters and compiled functions free the interpreter while they run, so that two threads are nearly twice as
fast as one; more would only hold more pieces in memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from queue import Empty, Full, Queue
from threading import Event, Thread
from typing import Any, TypeVar

Item = TypeVar("Item")

_END = object()
_PATIENCE = 0.1  # s after which a reader looks whether anyone still wants its pieces


def ahead(items: Iterable[Item], depth: int = 1) -> Iterator[Item]:
    """The same items in the same order, made on another thread.

    Parameters
    ----------
    items : iterable
        Gone through on that thread; what it raises is raised here, after the items before.  A sequence is there already
        and needs no thread.
    depth : int
        Items that may wait to be taken; one more is in the making.

    Examples
    --------
    >>> list(ahead(iter(range(4))))
    [0, 1, 2, 3]
    """
    if isinstance(items, Sequence):
        yield from items
        return
    waiting: Queue[Any] = Queue(max(depth, 1))
    stopped = Event()
    reader = Thread(target=_read, args=(items, waiting, stopped), daemon=True)
    reader.start()
    try:
        while True:
            item, error = waiting.get()
            if error is not None:
                raise error
            if item is _END:
                return
            yield item
            del item
    finally:
        stopped.set()
        with suppress(Empty):
            waiting.get_nowait()
        reader.join()


def _read(items: Iterable[Any], waiting: Queue[Any], stopped: Event) -> None:
    try:
        for item in items:
            if not _put((item, None), waiting, stopped):
                return
            del item
    except BaseException as error:
        _put((None, error), waiting, stopped)
    else:
        _put((_END, None), waiting, stopped)


def _put(entry: Any, waiting: Queue[Any], stopped: Event) -> bool:
    """Hand an item over, unless nobody wants it any more."""
    while not stopped.is_set():
        with suppress(Full):
            waiting.put(entry, timeout=_PATIENCE)
            return True
    return False
