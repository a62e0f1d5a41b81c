"""Arguments of the functions of robots: names, order, labels and units, the same for all of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.algebra import Argument, Function, Op, Program, Scalar
from echelon.robot import Mechanism, MotionKind, symbol_values

STATE = ("q", "qd", "qdd")  # positions, velocities and accelerations

_RATES = {
    "qd": "joint velocities",
    "qdd": "joint accelerations",
    "qdr": "reference velocities",
    "qddr": "reference accelerations",
}

STANDARD = "standard_parameters"  # the argument of functions that base parameters do not determine


@dataclass(frozen=True)
class Arguments:
    """Makes the arguments of one function."""

    mechanism: Mechanism
    program: Program
    parameters: Mapping[str, str]  # names of the parameters and their units, in order
    standard: bool = False  # whether they are the standard parameters

    def of(self, names: Sequence[str], outputs: Iterable[int]) -> tuple[Argument, ...]:
        """Arguments of ``q qd qdd qdr qddr y inputs parameters symbols``; ``symbols`` and ``inputs`` if needed."""
        used = [
            n for n in self.program.needed(outputs) if self.program.ops[n] == Op.INPUT
        ]
        found: list[Argument] = []
        for name in names:
            match name:
                case "q":
                    found.append(self._positions())
                case "qd" | "qdd" | "qdr" | "qddr":
                    found.append(self._rates(name))
                case "y":
                    found.append(self._outputs())
                case "parameters":
                    found.append(self._parameters())
                case _:
                    found += (
                        self._inputs(used) if name == "inputs" else self._symbols(used)
                    )
        return tuple(found)

    def function(
        self,
        name: str,
        entries: Mapping[tuple[int, ...], Scalar],
        axes: tuple[tuple[str, ...], ...],
        arguments: str,
        meaning: str,
        units: tuple[str, ...] = (),
    ) -> Function:
        """The function with these entries, of arguments whose names are separated by spaces."""
        nodes = {
            index: value.node for index, value in entries.items() if not value.is_zero
        }
        return Function(
            name,
            self.program,
            self.of(arguments.split(), nodes.values()),
            nodes,
            axes,
            units,
            meaning,
        )

    def _named(
        self, name: str, labels: Sequence[str], units: Sequence[str], meaning: str
    ) -> Argument:
        nodes = tuple(self.program.input(f"{name}[{label}]").node for label in labels)
        return Argument(name, nodes, tuple(labels), tuple(units), meaning)

    def _positions(self) -> Argument:
        mechanism = self.mechanism
        of = (
            ", all of them, which close the loops"
            if mechanism.dependent_velocities
            else ""
        )
        return self._named(
            "q",
            mechanism.positions,
            coordinate_units(mechanism, "q"),
            f"joint positions{of}",
        )

    def _rates(self, kind: str) -> Argument:
        meaning = _RATES[kind]
        units = dict(
            zip(
                self.mechanism.velocities,
                coordinate_units(self.mechanism, kind.replace("r", "")),
                strict=True,
            )
        )
        labels = self.mechanism.independent_velocities
        of = ", independent" if self.mechanism.dependent_velocities else ""
        return self._named(kind, labels, [units[name] for name in labels], meaning + of)

    def _outputs(self) -> Argument:
        units = [output.unit for output in self.mechanism.outputs]
        return self._named("y", row_names(self.mechanism), units, "outputs")

    def _parameters(self) -> Argument:
        inputs = (
            parameter_input(name, standard=self.standard) for name in self.parameters
        )
        nodes = tuple(self.program.input(n, "symbol").node for n in inputs)
        units = tuple(self.parameters.values())
        name, meaning = (
            (STANDARD, "standard parameters")
            if self.standard
            else ("parameters", "dynamic parameters")
        )
        return Argument(
            name, nodes, tuple(self.parameters), units, meaning, uniform=True
        )

    def _inputs(self, used: Sequence[int]) -> list[Argument]:
        names = {
            self.program.inputs[n].name: n
            for n in used
            if self.program.inputs[n].name.startswith("i[")
        }
        if not names:
            return []
        labels = tuple(name[2:-1] for name in names)
        meaning = "measured inputs, such as the currents of drives"
        return [
            Argument(
                "inputs", tuple(names.values()), labels, ("SI",) * len(names), meaning
            )
        ]

    def _symbols(self, used: Sequence[int]) -> list[Argument]:
        parameters = {
            parameter_input(name, standard=self.standard) for name in self.parameters
        }
        inputs = {
            self.program.inputs[n].name: n
            for n in used
            if self.program.inputs[n].role == "symbol"
        }
        known = list(self.mechanism.symbols)
        names = sorted(
            inputs.keys() - parameters,
            key=lambda n: (known.index(n) if n in known else len(known), n),
        )
        if not names:
            return []
        nodes = tuple(inputs[name] for name in names)
        return [
            Argument(
                "symbols",
                nodes,
                tuple(names),
                ("SI",) * len(names),
                "geometry",
                uniform=True,
            )
        ]


def geometry_values(
    mechanism: Mechanism,
    arguments: Iterable[Argument],
    symbols: Mapping[str, float] | None = None,
) -> dict[str, npt.NDArray[np.float64]]:
    """Values of the argument ``symbols``, SI units, where a function has it."""
    geometry = [argument for argument in arguments if argument.name == "symbols"]
    return {
        a.name: np.array(list(symbol_values(mechanism, a.labels, symbols).values()))
        for a in geometry
    }


def parameter_input(name: str, *, standard: bool = False) -> str:
    """Name of a parameter's input, which no geometry symbol can have; of a base parameter's by its representative."""
    return f"s[{name}]" if standard else f"p[{name}]"


def row_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Labels of the rows of a result: names of the outputs."""
    return tuple(output.name for output in mechanism.outputs)


def coordinate_units(mechanism: Mechanism, kind: str) -> list[str]:
    """SI units of all positions (``q``), velocities (``qd``) or accelerations (``qdd``)."""
    suffix = {"q": "", "qd": "/s", "qdd": "/s²"}[kind]
    units: list[str] = []
    for motion in mechanism.motions:
        if motion.name in mechanism.dependent:
            continue
        if motion.kind is MotionKind.BALL:
            units += ["1"] * 4 if kind == "q" else [f"rad{suffix}"] * 3
        else:
            units.append(
                ("m" if motion.kind is MotionKind.TRANSLATION else "rad") + suffix
            )
    return units
