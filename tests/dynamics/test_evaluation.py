"""Base models at states: machine code against the recorded forms and functions in plain NumPy."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.base.model import BaseModel
from echelon.compute.machine import kernel as kernel_module
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.functions import robot_function
from echelon.dynamics.linear_forms import inverse_dynamics_regressor
from echelon.shared.errors import InputError
from support import textbook_arms as arms
from support.described_robots import EVERYTHING, SENSORS
from support.float_functions import evaluate
from support.float_regressor import FloatArray, random_states
from support.paths import EXAMPLES
from support.selection import slow_unless
from support.small_kernels import same_bits

SAMPLES = 11

MODELS: dict[str, Callable[[], ec.Mechanism]] = {
    "panda": lambda: ec.load(EXAMPLES / "panda.yaml"),
    "floating tree": lambda: ec.load(EXAMPLES / "floating_tree.yaml"),
    "actuators, rotors and friction": lambda: ec.load(EXAMPLES / "tx40.yaml"),
    "couplings": lambda: ec.load(EXAMPLES / "gripper_coupled.yaml"),
    "screw": lambda: ec.load(EXAMPLES / "scara.yaml"),
    "ball": arms.spherical,
    "nothing to identify": arms.rigid,
}

GRAVITY = {"ball": {"g": 9.81}}
"""Symbols without values."""


def described(folder: Path, text: str) -> ec.Mechanism:
    (folder / "robot.yaml").write_text(text, encoding="utf-8")
    return ec.load(folder / "robot.yaml")


class Case:
    """A base model at random states with random base parameters; symbols that have no value, and measured inputs."""

    def __init__(
        self,
        mechanism: ec.Mechanism,
        symbols: dict[str, float] | None = None,
        **inputs: FloatArray,
    ) -> None:
        self.base: BaseModel = ec.base_parameters(mechanism)
        self.mechanism, self.inputs = mechanism, inputs
        self.q, self.qd, self.qdd = random_states(mechanism, SAMPLES)
        self.state = self.q, self.qd, self.qdd
        self.values = np.random.default_rng(2).normal(size=self.base.rank)
        self.symbols = symbols or {}
        self.known = {"symbols": self.symbols, "inputs": inputs}

    def forms(self) -> FloatArray:
        """X of the recorded forms in plain NumPy."""
        forms = inverse_dynamics_regressor(self.mechanism)
        return evaluate_floats(
            forms, self.mechanism, *self.state, self.symbols, self.inputs
        )

    def function(self, name: str) -> FloatArray:
        """A recorded function in plain NumPy."""
        made = robot_function(name, self.mechanism, self.base.matrix.pivots)
        values: dict[str, Any] = {
            "q": self.q,
            "qd": self.qd,
            "qdd": self.qdd,
            "parameters": self.values,
        }
        labels = {argument.name: argument.labels for argument in made.arguments}
        if "inputs" in labels:
            values["inputs"] = np.stack(
                [self.inputs[name] for name in labels["inputs"]], axis=1
            )
        known = {
            name: s.value for name, s in self.mechanism.symbols.items()
        } | self.symbols
        values["symbols"] = [known[name] for name in labels.get("symbols", ())]
        return evaluate(made, self.mechanism, values)


SUBSUMED = ("panda", "actuators, rotors and friction", "everything")
"""Robots that have nothing that others do not have."""
CURRENT = np.random.default_rng(8).normal(size=SAMPLES)


@pytest.fixture(
    scope="module",
    params=slow_unless(
        lambda name: name not in SUBSUMED,
        [*MODELS, "everything", "everything with sensors"],
    ),
)
def case(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Case:
    if request.param in MODELS:
        return Case(MODELS[request.param](), GRAVITY.get(request.param))
    text = EVERYTHING + (SENSORS if "sensors" in request.param else "")
    return Case(described(tmp_path_factory.mktemp("robots"), text), j1=CURRENT)


def check(found: FloatArray, expected: FloatArray) -> None:
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=1e-13 * (1e-9 + np.abs(expected).max(initial=0))
    )


# -- values --------------------------------------------------------------------------------------------------------


def test_regressors(case: Case) -> None:
    base, x = case.base, case.forms()
    check(base.standard_regressor(*case.state, **case.known), x)
    pivots = list(base.matrix.pivots)
    reduced = base.regressor(*case.state, **case.known)
    check(reduced, x[:, :, pivots])
    check(reduced @ base.B_float(case.symbols), x)


def test_entries(case: Case) -> None:
    """The entries that are not structurally zero, put where they belong, are the regressor."""
    base = case.base
    rows, columns = base.sparsity
    whole = np.zeros((SAMPLES, len(case.mechanism.outputs), base.rank))
    whole[:, rows, columns] = base.regressor_entries(*case.state, **case.known)
    assert same_bits(whole, base.regressor(*case.state, **case.known))
    assert len({*zip(rows.tolist(), columns.tolist(), strict=True)}) == len(rows)


@pytest.mark.parametrize(
    "name", ["inverse_dynamics", "gravity", "coriolis", "effects", "mass_matrix"]
)
def test_functions(case: Case, name: str) -> None:
    base, symbols = case.base, case.symbols
    found = {
        "inverse_dynamics": lambda: base.predict(
            *case.state, case.values, **case.known
        ),
        "gravity": lambda: base.gravity(case.q, case.values, symbols),
        "coriolis": lambda: base.coriolis(case.q, case.qd, case.values, symbols),
        "effects": lambda: base.effects(case.q, case.qd, case.values, **case.known),
        "mass_matrix": lambda: base.mass_matrix(case.q, case.values, symbols),
    }
    check(found[name](), case.function(name))


def test_derivatives(case: Case) -> None:
    by_position, by_velocity = case.base.inverse_dynamics_derivatives(
        *case.state, case.values, **case.known
    )
    outputs = len(case.mechanism.outputs)
    assert by_position.shape == (SAMPLES, outputs, len(case.mechanism.positions))
    assert by_velocity.shape == (SAMPLES, outputs, len(case.mechanism.velocities))
    check(
        np.concatenate([by_position, by_velocity], axis=2),
        case.function("inverse_dynamics_derivatives"),
    )


def test_parts_make_the_whole(case: Case) -> None:
    """y = X̄ ζ̄ = M q̈ + c + g + e."""
    base, symbols = case.base, case.symbols
    y = base.predict(*case.state, case.values, **case.known)
    check(base.regressor(*case.state, **case.known) @ case.values, y)
    parts = base.gravity(case.q, case.values, symbols) + base.coriolis(
        case.q, case.qd, case.values, symbols
    )
    parts += base.effects(case.q, case.qd, case.values, **case.known)
    check(
        np.einsum(
            "kij,kj->ki", base.mass_matrix(case.q, case.values, symbols), case.qdd
        )
        + parts,
        y,
    )


# -- calls ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def panda() -> Case:
    return Case(MODELS["panda"]())


def test_one_state_lists_and_results(
    panda: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One state gives one result, and results may be written to the caller's arrays, also by several threads."""
    monkeypatch.setattr(kernel_module, "_FEWEST", 1)
    base, values = panda.base, panda.values
    one = [array[3] for array in panda.state]
    for call, shape in (
        (lambda *s, **k: base.regressor(*s, **k), (7, 43)),
        (lambda *s, **k: base.standard_regressor(*s, **k), (7, 70)),
        (lambda *s, **k: base.regressor_entries(*s, **k), (len(base.sparsity[0]),)),
        (lambda *s, **k: base.predict(*s, values, **k), (7,)),
    ):
        whole = call(*panda.state)
        assert whole.shape == (SAMPLES, *shape)
        assert same_bits(call(*one), whole[3])
        assert same_bits(call(*(array[None] for array in one)), whole[3:4])
        single = np.full(shape, 7.0)
        assert call(*one, out=single) is single
        assert same_bits(single, whole[3])
        assert same_bits(call(*(array.tolist() for array in panda.state)), whole)
        out = np.full(whole.shape, 7.0)
        assert call(*panda.state, out=out, threads=2) is out
        assert same_bits(out, whole)
        with pytest.raises(InputError, match="out has shape"):
            call(*one, out=out)
    assert base.gravity(one[0], values).shape == (7,)
    both = base.inverse_dynamics_derivatives(*one, values)
    assert [part.shape for part in both] == [(7, 7), (7, 7)]


def test_big_batches(panda: Case) -> None:
    """Results beyond the caches, which are written in another way by several threads, are the same bit by bit."""
    state = random_states(panda.mechanism, 6000)
    for call in (
        panda.base.regressor,
        panda.base.standard_regressor,
        panda.base.regressor_entries,
    ):
        whole = call(*state)
        assert whole.nbytes > kernel_module._CACHED_BYTES
        for first in (0, 1, 4567):
            assert same_bits(
                call(*(array[first : first + 50] for array in state)),
                whole[first : first + 50],
            )


def test_other_geometry(panda: Case) -> None:
    """Symbols replace those of the file, as in a file that states them."""
    other = arms.panda(lengths=("0.4", "0.25", "0.35", "0.07", "0.1"))
    found = panda.base.standard_regressor(
        *panda.state, symbols={"d1": 0.4, "d3": 0.25, "d5": 0.35, "a4": 0.07, "a7": 0.1}
    )
    check(
        found, evaluate_floats(inverse_dynamics_regressor(other), other, *panda.state)
    )
    assert not np.allclose(found, panda.base.standard_regressor(*panda.state))


def test_symbols_without_values() -> None:
    base = ec.base_parameters(ec.load(EXAMPLES / "stanford.yaml"))
    state = random_states(base.mechanism, 3)
    with pytest.raises(
        InputError, match="symbol 'd2' has no value; give it as symbols="
    ):
        base.regressor(*state)
    assert base.regressor(*state, symbols={"d2": 0.15}).shape == (3, 6, base.rank)
    with pytest.raises(InputError, match="'D2' is not a symbol of this mechanism"):
        base.regressor(*state, symbols={"D2": 0.15})
    with pytest.raises(
        InputError, match="argument 'symbols' of regressor: needs a mapping"
    ):
        base.regressor(*state, np.array([0.15]))  # type: ignore[arg-type]


def test_wrong_arguments(panda: Case) -> None:
    base, (q, qd, qdd) = panda.base, panda.state
    with pytest.raises(
        InputError, match=r"q has shape \(11, 6\); expected \(samples, 7\): j1, j2"
    ):
        base.regressor(q[:, :6], qd, qdd)
    with pytest.raises(
        InputError, match="different numbers of samples: q 11, qd 11, qdd 4"
    ):
        base.predict(q, qd, qdd[:4], panda.values)
    with pytest.raises(
        InputError, match=r"parameters has shape \(42,\); expected \(43,\): ZZ1, "
    ):
        base.gravity(q, panda.values[1:])
    with pytest.raises(InputError, match="threads is 0"):
        base.mass_matrix(q, panda.values, threads=0)


def test_measured_inputs(tmp_path: Path) -> None:
    case = Case(described(tmp_path, EVERYTHING), j1=CURRENT)
    base, state = case.base, case.state
    found = base.regressor(*state, inputs={"j1": CURRENT})
    gain = [case.mechanism.columns[p].name for p in base.matrix.pivots].index("Kt1")
    row = [output.name for output in case.mechanism.outputs].index("j1")
    np.testing.assert_array_equal(np.abs(found[:, row, gain]), np.abs(CURRENT))
    assert same_bits(
        base.regressor(*(a[2] for a in state), inputs={"j1": CURRENT[2]}), found[2]
    )
    with pytest.raises(
        InputError,
        match=r"the measured input i\[j1\] is needed; give it as inputs=\{'j1': \.\.\.\}",
    ):
        base.regressor(*state)
    with pytest.raises(InputError, match=r"different numbers of samples: .*inputs 5"):
        base.regressor(*state, inputs={"j1": CURRENT[:5]})
    with pytest.raises(
        InputError,
        match=r"measured inputs must be vectors of equal length; got shapes \(11, 1\)",
    ):
        base.regressor(*state, inputs={"j1": CURRENT[:, None]})
    with pytest.raises(
        InputError,
        match="argument 'inputs' of regressor: needs a mapping of a text to an array of numbers",
    ):
        base.regressor(*state, inputs={"j1": CURRENT * 1j})


def test_code_is_made_once(panda: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    base = ec.base_parameters(panda.mechanism)
    first = base.predict(*panda.state, panda.values)
    monkeypatch.delattr(kernel_module, "loaded")
    assert same_bits(base.predict(*panda.state, panda.values), first)


def test_copies(panda: Case) -> None:
    """A model that has been evaluated can be copied and compared."""
    base = ec.base_parameters(panda.mechanism)
    first = base.predict(*panda.state, panda.values)
    twin = copy.deepcopy(base)
    assert twin == base
    assert same_bits(twin.predict(*panda.state, panda.values), first)
