"""Arguments of wrong kinds end in one line that names the argument and says what would be valid."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.shared.doors import kind_of, public
from echelon.shared.errors import InputError
from support.paths import EXAMPLES


def callables() -> Iterator[Any]:
    for name in ec.__all__:
        member = getattr(ec, name)
        if inspect.isfunction(member):
            yield pytest.param(member, id=name)
        elif inspect.isclass(member) and not issubclass(member, Exception):
            for key, method in vars(member).items():
                function = getattr(method, "__func__", method)
                if (
                    inspect.isfunction(function)
                    and not key.startswith("_")
                    and len(inspect.signature(function).parameters) > 1
                ):
                    yield pytest.param(function, id=f"{name}.{key}")


@pytest.mark.parametrize("function", list(callables()))
def test_every_public_function_checks_its_arguments(
    function: Callable[..., object],
) -> None:
    assert hasattr(function, "__wrapped__")


@cache
def base() -> ec.BaseModel:
    return ec.base_parameters(EXAMPLES / "double_pendulum.yaml")


@cache
def linear() -> ec.LinearBase:
    return ec.base_parameters(ec.load_linear(EXAMPLES / "linear/single_track.yaml"))


STATE = {name: np.ones((3, 2)) for name in ("q", "qd", "qdd")}
CALLS: dict[str, Callable[[Any], object]] = {
    "variables of regressor": lambda wrong: linear().regressor(wrong),
    "constants of values": lambda wrong: linear().values(
        np.ones(len(linear().parameters)), wrong
    ),
    "threads of regressor": lambda wrong: base().regressor(**STATE, threads=wrong),
    "q of regressor": lambda wrong: base().regressor(**{**STATE, "q": wrong}),
    "values of predict": lambda wrong: base().predict(**STATE, values=wrong),
    "log of accumulate": lambda wrong: base().accumulate(wrong),
    "seed of base_parameters": lambda wrong: ec.base_parameters(
        base().mechanism, seed=wrong
    ),
    "prefer of base_parameters": lambda wrong: ec.base_parameters(
        base().mechanism, prefer=wrong
    ),
    "budget of base_parameters": lambda wrong: ec.base_parameters(
        base().mechanism, budget=wrong
    ),
    "progress of base_parameters": lambda wrong: ec.base_parameters(
        base().mechanism, progress=wrong
    ),
    "size of sensor_report": lambda wrong: ec.sensor_report(base().mechanism, wrong),
    "locked of load": lambda wrong: ec.load(EXAMPLES / "panda.yaml", locked=wrong),
    "massless of load": lambda wrong: ec.load(EXAMPLES / "panda.yaml", massless=wrong),
    "target of generate": lambda wrong: ec.generate(base(), wrong),
    "path of load_linear": lambda wrong: ec.load_linear(wrong),
    "values of convert": lambda wrong: ec.convert(wrong, "echelon", "pinocchio"),
    "outputs of init": lambda wrong: ec.LinearModel(
        [["x"]], ["x"], ["p"], outputs=wrong
    ),
    "identification of report_html": lambda wrong: ec.report_html(wrong),
    "known of init": lambda wrong: ec.Payload("j2", wrong),
    "tolerances of compare_numeric": lambda wrong: ec.compare_numeric(
        base().mechanism, tolerances=wrong
    ),
}
WRONG = [object(), b"x", {"a": object()}, -1.5, ["a", None]]


@pytest.mark.parametrize("wrong", WRONG, ids=[type(wrong).__name__ for wrong in WRONG])
@pytest.mark.parametrize("argument", CALLS)
def test_the_argument_and_what_would_be_valid_are_named(
    argument: str, wrong: object
) -> None:
    name, function = argument.split(" of ")
    with pytest.raises(InputError) as caught:
        CALLS[argument](wrong)
    said = str(caught.value)
    assert len(said) < 300
    number_for_array = name in ("q", "values", "log") and not isinstance(
        wrong, bytes | list
    )  # functions judge shapes
    assert number_for_array or said.startswith(
        f"argument '{name}' of {function}: needs "
    )


@pytest.mark.parametrize(
    ("annotation", "accepted", "refused"),
    [
        (int, [1, np.int64(2)], [1.0, True, "1", None]),
        (
            float,
            [1, 0.5, np.float32(1), float("inf")],
            ["1", True, float("nan"), 10**400, None],
        ),
        (int | None, [None, 3], ["3"]),
        (list[str], [["a"], ("a",)], ["a", [1], {"a": 1}]),
        (dict[str, float], [{}, {"a": 1}], [{1: 1}, {"a": "1"}, [("a", 1)]]),
    ],
)
def test_annotations_say_what_is_accepted(
    annotation: Any, accepted: list[Any], refused: list[Any]
) -> None:
    kind = kind_of(annotation)
    assert kind is not None
    assert [value for value in accepted if not kind.accepts(value)] == []
    assert [value for value in refused if kind.accepts(value)] == []


def test_what_is_imported_for_type_checkers_only_is_not_checked() -> None:
    @public
    def function(value: Unknown) -> object:  # type: ignore[name-defined]  # noqa: F821
        return value

    assert function(3) == 3


def test_frozen_results_have_a_hash() -> None:
    again = ec.base_parameters(EXAMPLES / "double_pendulum.yaml")
    assert hash(base()) == hash(again)
    assert base() == again
    assert hash(linear()) == hash(linear())
    assert hash(base().mechanism) != hash(ec.load(EXAMPLES / "panda.yaml"))
    for name in ec.__all__:
        member = getattr(ec, name)
        if is_dataclass(member):
            assert member.__hash__ is not None, name
