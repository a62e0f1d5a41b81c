"""From base parameters to source files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echelon.base.model import BaseModel
from echelon.codegen.constants import SHARED, kept_symbols, parameter_constants, specialised, symbol_constants
from echelon.codegen.documentation import Subject, documentation
from echelon.codegen.language import TARGETS, Language, Precision, checked_identifier, identifier
from echelon.codegen.views import LANES, view
from echelon.dynamics.functions import ALL_FUNCTIONS
from echelon.errors import InputError, one_line
from echelon.program.function import Argument, Function
from echelon.program.operations import Op
from echelon.version import __version__

if TYPE_CHECKING:
    from jinja2 import Environment

DEFAULT_FUNCTIONS = ("regressor", "inverse_dynamics", "mass_matrix", "gravity")
"""What is generated unless something else is asked for; with loops also ``closed_positions``."""


@dataclass(frozen=True)
class Source:
    """Generated source: text by file name, and the functions with all constants put in."""

    files: Mapping[str, str]
    functions: tuple[Function, ...]


def generate(
    base: BaseModel,
    target: str = "c",
    functions: Sequence[str] | None = None,
    *,
    name: str | None = None,
    precision: str = "double",
    parameters: str | Mapping[str, float] | None = None,
    symbols: Mapping[str, float] | None = None,
    keep_symbols: bool | Sequence[str] = False,
    remarks: Sequence[str] = (),
) -> dict[str, str]:
    """Source code of functions of a robot.

    Parameters
    ----------
    base : BaseModel
        Made by :func:`echelon.base_parameters` or :func:`echelon.load_base`.
    target : str
        ``"c"``, ``"cpp"``, ``"cuda"``, ``"python"``, ``"jax"``, ``"casadi"``, ``"matlab"``, ``"julia"`` or ``"rust"``.
    functions : sequence of str, optional
        Of ``"regressor"``, ``"inverse_dynamics"``, ``"mass_matrix"``, ``"gravity"``, ``"coriolis"``, ``"effects"``,
        ``"inverse_dynamics_derivatives"``, and with loops ``"closed_positions"``, ``"closed_velocities"``,
        ``"closed_accelerations"``, ``"closure_pivots"``, ``"constraint_forces"``; :data:`DEFAULT_FUNCTIONS` if omitted,
        without the mass matrix where effects leave none.
    name : str, optional
        Stands before the functions' names and names the files; made from the robot's name if omitted.
    precision : str
        ``"double"`` or ``"single"``.
    parameters : mapping of str to float, or "file", optional
        Values to put in for the parameters, which are an argument otherwise: those of all base parameters, by the names
        of their representatives, or of all standard parameters; ``"file"`` for those that the robot's file states.
    symbols : mapping of str to float, optional
        Values of geometry symbols that replace or complete those of the file, SI units.  Symbols without a value become
        an argument.
    keep_symbols : bool or sequence of str
        Geometry symbols that become an argument although they have values: all, or these.  The base parameters then
        belong to the geometry that is passed, and the functions are right wherever the same parameters are
        representatives as for the robot's own values.
    remarks : sequence of str
        Lines for the comment at the head of every file, such as where identified values hold.

    Returns
    -------
    dict of str to str
        Text of the files by name.

    Raises
    ------
    InputError
        If a target, function, precision or name is not valid, or values are missing.

    Examples
    --------
    >>> import echelon as ec
    >>> base = ec.base_parameters(ec.load("examples/double_pendulum.yaml"))
    >>> from echelon.codegen import generate
    >>> list(generate(base, "c", ["inverse_dynamics"]))
    ['double_pendulum.h', 'double_pendulum.c']
    """
    source = generate_source(
        base,
        target,
        functions,
        name=name,
        precision=precision,
        parameters=parameters,
        symbols=symbols,
        keep_symbols=keep_symbols,
        remarks=remarks,
    )
    return dict(source.files)


def generate_source(
    base: BaseModel,
    target: str,
    functions: Sequence[str] | None,
    *,
    name: str | None = None,
    precision: str = "double",
    parameters: str | Mapping[str, float] | None = None,
    symbols: Mapping[str, float] | None = None,
    keep_symbols: bool | Sequence[str] = False,
    remarks: Sequence[str] = (),
) -> Source:
    """As :func:`generate`, with the functions that were printed."""
    language = TARGETS[_valid("target", target, list(TARGETS))]
    if functions is None:
        functions, left_out = _default_functions(base)
        remarks = (*remarks, *left_out)
    chosen = [_valid("function", function, list(ALL_FUNCTIONS)) for function in dict.fromkeys(functions)]
    if not chosen:
        raise InputError(f"no function is asked for (valid: {', '.join(ALL_FUNCTIONS)})")
    mode = Precision.named(precision)
    robot = identifier(base.mechanism.name) if name is None else checked_identifier(name)
    kept = kept_symbols(base.mechanism, keep_symbols, symbols)
    if kept and parameters is not None:
        raise InputError("parameters that are put in belong to one geometry: give them, or keep symbols, not both")
    constants = symbol_constants(base.mechanism, symbols, kept)
    values = parameter_constants(base, parameters, symbols)
    made = [base.function(function) for function in chosen]
    known = {**constants.numbers, **values.numbers}
    layout = _layout(made, known)
    made = [specialised(function, known, layout) for function in made]
    subject = Subject(base.mechanism.name, base.expressions, constants.texts, values.values, constants.stated, remarks)
    return Source(printed(made, language, mode, robot, subject), tuple(made))


def _default_functions(base: BaseModel) -> tuple[list[str], list[str]]:
    """The functions that are written by default; why there is no mass matrix, where effects leave none."""
    names = [*DEFAULT_FUNCTIONS, *["closed_positions"] * bool(base.mechanism.closures)]
    try:
        base.function("mass_matrix")
    except InputError as error:
        names.remove("mass_matrix")
        return names, [f"mass_matrix is left out: {error}"]
    return names, []


def printed(
    functions: Sequence[Function], language: Language, precision: Precision, robot: str, subject: Subject
) -> dict[str, str]:
    """Text of the files by name; ``robot`` is an identifier, the subject is for the documentation."""
    views = [view(function, language, precision) for function in functions]
    context = {
        "robot": robot,
        "module": "".join(word[:1].upper() + word[1:] for word in robot.split("_")),
        "uniform": sorted({a.name for shown in views for a in shown.arguments if a.uniform}),
        "version": __version__,
        "doc": documentation(subject, views, language),
        "functions": views,
        "real": language.real[precision],
        "precision": precision.value,
        "lanes": LANES,
        "suffix": precision.suffix,
        "zero": language.literal(0, precision),
        "one": language.literal(1, precision),
        "trigonometric": any(shown.angles for shown in views),
        "operations": _operations(functions),
    }
    files: dict[str, str] = {}
    for pattern, template in language.files.items():
        if "{function}" not in pattern:
            files[pattern.format(robot=robot)] = _render(template, context)
            continue
        for shown in views:
            own = {"function": shown, "doc": documentation(subject, [shown], language)}
            files[pattern.format(robot=robot, function=shown.name)] = _render(template, {**context, **own})
    return files


def _operations(functions: Sequence[Function]) -> set[str]:
    """Names of all operations that occur."""
    return {Op(f.program.ops[node]).name for f in functions for node in f.needed}


def _layout(functions: Sequence[Function], known: Mapping[str, object]) -> dict[str, list[str]]:
    """What any of the functions takes in the arguments that hold what is used."""
    labels: dict[str, dict[str, None]] = {name: {} for name in SHARED}
    for function in functions:
        for argument in function.arguments:
            if argument.name in labels:
                inputs = (function.program.inputs[node].name for node in argument.nodes)
                pairs = zip(argument.labels, inputs, strict=True)
                labels[argument.name] |= {label: None for label, name in pairs if name not in known}
    return {name: list(found) for name, found in labels.items()}


def _valid(what: str, value: str, valid: Sequence[str]) -> str:
    if value not in valid:
        raise InputError(f"there is no {what} '{one_line(value)}' (valid: {', '.join(valid)})")
    return value


# -- templates ---------------------------------------------------------------------------------------------------------

TEMPLATES = Path(__file__).with_name("templates")


def _render(template: str, context: Mapping[str, Any]) -> str:
    """A template with its names filled in; a name without value is an error."""
    return _environment().get_template(template).render(context)


@cache
def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        undefined=StrictUndefined,
        autoescape=False,  # source code, not pages
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"each": _each, "padded": _padded, "listed": _listed, "renamed": _renamed, "owned": _owned}
    return environment


def _each(arguments: Sequence[Argument], pattern: str) -> list[str]:
    """A pattern with ``{name}`` and ``{size}`` of every argument."""
    return [pattern.format(name=argument.name, size=len(argument)) for argument in arguments]


def _owned(arguments: Sequence[Argument]) -> list[str]:
    """Names of arguments, those that vary from sample to sample as copies of one sample."""
    return [argument.name if argument.uniform else f"own_{argument.name}" for argument in arguments]


def _renamed(names: Sequence[str], other: Mapping[str, str]) -> list[str]:
    """Names, some of them replaced."""
    return [other.get(name, name) for name in names]


def _padded(items: Sequence[str], length: int, filler: str) -> list[str]:
    """A list made longer."""
    return [*items, *[filler] * (length - len(items))]


def _listed(items: Sequence[str], indent: int, width: int = 110) -> str:
    """Items with commas, in lines that are not too long."""
    lines = [""]
    for item in items:
        if lines[-1] and len(lines[-1]) + len(item) > width - indent:
            lines.append("")
        lines[-1] += f"{item}, "
    return ("\n" + " " * indent).join(line.rstrip() for line in lines).rstrip(",")
