"""Objects of every public class can be copied and sent to other processes, before and after they are used."""

from __future__ import annotations

import multiprocessing
import pickle
from copy import deepcopy
from typing import Any

import numpy as np
import pytest

from support.api_objects import OBJECTS, held, public_classes, used
from support.selection import slow_unless

SLOW_TO_USE = ("identification", "excitation")
"""Used in this process only, and not in others as well: what they hold is."""


def pickled(found: Any) -> Any:
    return pickle.loads(pickle.dumps(found))


@pytest.mark.parametrize("copied", slow_unless([pickled], [pickled, deepcopy]))
@pytest.mark.parametrize(
    "name", slow_unless(lambda name: name not in ("base of a loop", "gains"), OBJECTS)
)
def test_a_copy_says_the_same(name: str, copied: Any) -> None:
    found, said = used(name)
    np.testing.assert_equal(OBJECTS[name].use(copied(OBJECTS[name].make())), said)
    np.testing.assert_equal(OBJECTS[name].use(copied(found)), said)


def test_no_public_class_is_forgotten() -> None:
    seen = held(*(used(name)[0] for name in OBJECTS))
    protocols = {
        kind for kind in public_classes() if getattr(kind, "_is_protocol", False)
    }
    assert public_classes() - seen.keys() == protocols


def test_parts_can_be_sent_alone() -> None:
    seen = held(*(used(name)[0] for name in OBJECTS))
    for kind in public_classes() & seen.keys():
        part = seen[kind][0]
        assert type(pickled(part)) is type(part)
        assert type(deepcopy(part)) is type(part)


def _use(objects: dict[str, Any], pipe: Any) -> None:
    pipe.send({name: OBJECTS[name].use(found) for name, found in objects.items()})


@pytest.mark.parametrize(
    "method", slow_unless(["fork"], multiprocessing.get_all_start_methods())
)
def test_other_processes_use_what_was_used_here(method: str) -> None:
    objects = {name: used(name) for name in OBJECTS if name not in SLOW_TO_USE}
    context = multiprocessing.get_context(method)
    here, there = context.Pipe(duplex=False)
    process = context.Process(
        target=_use, args=({name: found for name, (found, _) in objects.items()}, there)
    )
    process.start()
    there.close()
    assert here.poll(60)
    np.testing.assert_equal(
        here.recv(), {name: said for name, (_, said) in objects.items()}
    )
    process.join()
