"""A robot file, parsed once: its mechanism, limits, collision shapes, set-up and written copies all start from here.

What a file says is kept as it stands, so that a mechanism can be built from it again with some numbers taken literally,
or with the joints that it couples independent.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echelon.dynamics import LinearModel
from echelon.formats.builder import Built, build_mechanism
from echelon.formats.literal import LiteralTree
from echelon.formats.snapping import ANGLE_TOLERANCE, Gravity, ReadingOptions
from echelon.formats.unit_questions import unit_questions
from echelon.formats.usual_effects import with_usual_effects
from echelon.formats.vocabulary import without
from echelon.robot import (
    Experiment,
    Mechanism,
    Reading,
    in_numbers,
    joined,
    lock_joints,
)
from echelon.shared import (
    DoubtWarning,
    InputError,
    Measured,
    locating,
    nearest_of,
    parse_xml,
    public,
    read_content,
)

if TYPE_CHECKING:
    from echelon.formats.description.document import Document
    from echelon.formats.mjcf.mjcf_model import MjcfDocument
    from echelon.formats.schema.robot_schema import RobotDescription
    from echelon.formats.schema.schema_experiments import ExperimentEntry


_DESCRIPTIONS = (".yaml", ".yml", ".json")
_XML = (".urdf", ".sdf", ".world", ".xml", ".mjcf", ".xacro")
_SUPPORTED = "URDF (.urdf), SDF (.sdf), MJCF (.xml, .mjcf) or an Echelon description (.yaml, .yml, .json)"


@dataclass(frozen=True)
class RobotFile:
    """The content of a robot file; everything else about it is parsed when it is first asked for, and kept."""

    data: bytes
    source: str  # name of the file, for messages
    is_description: bool  # whether it is YAML or JSON, rather than XML
    directory: Path | None = None  # where files that it includes are looked for
    ignored: tuple[
        str, ...
    ] = ()  # elements and attributes of XML that count as if they were not there
    model: str = (
        ""  # which of several models of an SDF file it is about; empty for the only one
    )

    @classmethod
    def of(cls, data: bytes, source: str, directory: Path | None = None) -> RobotFile:
        """A file from its content; the name, or for XML the content, decides about the format."""
        suffix = Path(source).suffix.lower()
        if suffix in _DESCRIPTIONS:
            return cls(data, source, True, directory)
        if not data.strip():
            raise InputError("the file is empty", source=source)
        if suffix in _XML or data.lstrip()[:1] == b"<":
            return cls(data, source, False, directory)
        raise InputError(f"unknown format; expected {_SUPPORTED}", source=source)

    def __getstate__(self) -> dict[str, object]:
        """Only the content goes to other processes; what was parsed is parsed there when it is needed."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    # -- descriptions ----------------------------------------------------------------------------------------------

    @cached_property
    def document(self) -> Document:
        """The plain data of a YAML or JSON file; of a list of frame pairs, the description that says the same."""
        from echelon.formats.description.document import read_text

        document = read_text(self.data, self.source)
        if (
            not isinstance(document.data, dict)
            or "closed_loop" not in document.data
            or "echelon" in document.data
        ):
            return document
        from echelon.formats.description.frame_pairs import as_description

        return as_description(document)

    @cached_property
    def description(self) -> RobotDescription:
        """A description, checked against the published schema."""
        from echelon.formats.description.document import check_document

        return check_document(self.document)

    @property
    def is_linear_model(self) -> bool:
        """Whether the file states a linear model rather than a robot."""
        stated = self.document.data if self.is_description else None
        return isinstance(stated, dict) and stated.get("model") == "linear"

    @cached_property
    def robot(self) -> RobotFile | None:
        """The XML file with the geometry: this one, or the one that a description adds to; None if there is none."""
        if not self.is_description:
            return self
        if self.description.robot is None:
            return None
        if self.directory is None:
            problem = "a description given as text cannot refer to another file"
            raise self.document.error("robot", problem)
        ignored = (*self.ignored, *self.description.robot.ignore)
        file = replace(
            open_robot(self.directory / self.description.robot.file, self.model),
            ignored=ignored,
        )
        if file.is_description:
            problem = (
                "only URDF, SDF and MJCF files can be added to; include the description"
            )
            raise InputError(problem, source=file.source)
        return file

    # -- XML -------------------------------------------------------------------------------------------------------

    @cached_property
    def root(self) -> Any:
        """The root element of an XML file: ``<robot>`` (URDF), ``<sdf>`` or ``<mujoco>`` (MJCF)."""
        root = parse_xml(self.data, self.source)
        if root.tag not in ("robot", "sdf", "mujoco"):
            problem = f"the root element is <{root.tag}>; expected <robot> (URDF), <sdf> (SDF) or <mujoco> (MJCF)"
            raise InputError(problem, source=self.source)
        return without(root, self.ignored, self.source) if self.ignored else root

    @cached_property
    def mjcf(self) -> MjcfDocument:
        """The text of an MJCF file with the files that it includes."""
        from echelon.formats.mjcf.mjcf_model import checked_mjcf

        return checked_mjcf(self.data, self.source, self.directory, self.ignored)

    def tree(self, *, mimics: bool = True) -> LiteralTree:
        """The links and joints of an XML file as they stand there."""
        if mimics not in self._trees:
            self._trees[mimics] = self._read_tree(mimics)
        return self._trees[mimics]

    @cached_property
    def _trees(self) -> dict[bool, LiteralTree]:
        return {}

    def _read_tree(self, mimics: bool) -> LiteralTree:
        if self.root.tag == "mujoco":
            from echelon.formats.mjcf.mjcf_reader import read_mjcf

            return read_mjcf(self.mjcf, mimics=mimics)
        if self.root.tag == "sdf":
            from echelon.formats.urdf.sdf_reader import read_sdf

            return read_sdf(self.root, self.source, mimics=mimics, model=self.model)
        from echelon.formats.urdf.urdf_reader import UrdfReader

        return UrdfReader(self.root, self.source).read(mimics)

    # -- mechanisms ------------------------------------------------------------------------------------------------

    def mechanism(
        self,
        options: ReadingOptions | None = None,
        literal: Collection[str] = (),
        *,
        alone: bool = False,
        free: bool = False,
    ) -> Mechanism:
        """The robot; the numbers of the literal elements are taken as they stand.

        Of a description with experiments it is all of them, or with ``alone`` the robot of each; with ``free`` nothing
        of it is locked.
        """
        options = ReadingOptions() if options is None else options
        if new := [name for name in options.ignore if name not in self.ignored]:
            return replace(self, ignored=(*self.ignored, *new)).mechanism(
                options, literal, alone=alone, free=free
            )
        built = self.built(options, literal)
        mechanism = built.mechanism if options.symbolic else in_numbers(built.mechanism)
        locked = self.locked(options)
        if locked and not free:
            with locating(self.source):
                mechanism = lock_joints(mechanism, locked)
        tree = (
            None
            if self.robot is None
            else self.robot.tree(mimics=not options.independent_mimics)
        )
        stated = self.description.effects if self.is_description else None
        trees = self.description.experiments if self.is_description else ()
        bases = tuple(entry for entry in trees if isinstance(entry, str))
        mechanism = replace(mechanism, experiments=bases) if bases else mechanism
        if options.usual_effects if stated is None else "usual" in stated:
            mechanism = with_usual_effects(
                mechanism, {} if tree is None else tree.drives
            )
        experiments = () if alone else self.experiments(mechanism, options.experiment)
        if experiments:
            with locating(self.source):
                mechanism = joined(experiments)
        couples = tree is not None and tree.has_mimics
        in_world = self.robot is not None and self.robot.root.tag != "robot"
        questions = tuple(
            unit_questions(mechanism, built.snapping.radians, in_world=in_world)
        )
        for question in questions if not literal else ():
            warnings.warn(f"{self.source}: {question}", DoubtWarning, stacklevel=3)
        notes = (*built.notes, *self._asked(), *questions)
        return mechanism.as_read(
            Reading(built.snaps, notes, self, options, couples, built.driven)
        )

    def locked(self, options: ReadingOptions) -> dict[str, float]:
        """Joints that do not move, and where they stand, rad or m."""
        stated = self.description.locked if self.is_description else {}
        return {**stated, **options.locked}

    def experiments(self, robot: Mechanism, chosen: str = "") -> tuple[Experiment, ...]:
        """The experiments that a description makes with a robot, or one of them; none where it states them as trees."""
        stated = self.description.experiments if self.is_description else ()
        if chosen:
            stated = (self._experiment(chosen),)
        entries = (entry for entry in stated if not isinstance(entry, str))
        return tuple(Experiment(robot, **entry.model_dump()) for entry in entries)

    def _experiment(self, name: str) -> ExperimentEntry:
        """One of the experiments that a description states."""
        stated = self.description.experiments if self.is_description else ()
        entries = {e.name: e for e in stated if not isinstance(e, str)}
        if name not in entries:
            raise InputError(
                f"there is no experiment '{name}'{nearest_of(name, list(entries))}",
                source=self.source,
            )
        return entries[name]

    @property
    def motions(self) -> dict[str, Path]:
        """Tables of motions that were driven, by experiment."""
        stated = self.description.experiments if self.is_description else ()
        motions = {e.name: e.motion for e in stated if not isinstance(e, str)}
        folder = Path(self.source).parent
        return {name: folder / path for name, path in motions.items() if path}

    def _asked(self) -> list[str]:
        """A note on what is ignored on request."""
        ignored = () if self.robot is None else self.robot.ignored
        if self.ignored and self.robot is None:
            raise InputError(
                f"it has no '{self.ignored[0]}' that could be ignored",
                source=self.source,
            )
        return (
            [f"ignored, as asked: {', '.join(dict.fromkeys(ignored))}"]
            if ignored
            else []
        )

    def built(self, options: ReadingOptions, literal: Collection[str] = ()) -> Built:
        """The robot with symbols, and what was read as exact."""
        try:
            if not self.is_description:
                return build_mechanism(
                    self.tree(mimics=not options.independent_mimics), options, literal
                )
            if self.robot is None:
                from echelon.formats.description.description_builder import (
                    build_description,
                )

                return build_description(
                    self.document, self.description, options, literal
                )
            from echelon.formats.description.stated_setup import add_to_file

            return add_to_file(
                self.document,
                self.description,
                options,
                partial(self.robot.built, literal=literal),
            )
        except InputError as error:
            raise error.located(self.source) from None


def open_robot(robot: Any, model: str = "") -> RobotFile:
    """A robot file of any supported format; or a text, a model or a name that stands for one.

    Of an SDF file with several models that move, the one with a name.
    """
    file = _opened(robot)
    if not model:
        return file
    file = replace(file, model=model)
    stated = None if file.is_linear_model else file.robot
    if stated is None or stated.root.tag != "sdf":
        raise InputError(
            f"only SDF files hold several models: leave out model '{model}'",
            source=file.source,
        )
    return file


def _opened(robot: Any) -> RobotFile:
    if isinstance(robot, RobotFile):
        return robot
    if not isinstance(robot, str | os.PathLike):
        from echelon.formats.robot_sources import text_of

        return RobotFile.of(*text_of(robot))
    text = os.fspath(robot)
    if isinstance(text, str) and text.lstrip().startswith("<"):
        return _expanded(text.encode(), "text", None)
    if isinstance(text, str) and (
        "\n" in text.strip() or text.lstrip().startswith("{")
    ):
        return RobotFile(text.encode(), "text.yaml", is_description=True)
    file = Path(text)
    if file.suffix.lower() in _DESCRIPTIONS:  # neither a name nor xacro
        return RobotFile.of(read_content(file), str(file), file.parent)
    from echelon.formats.robot_sources import described_path

    file = described_path(str(text)) or file
    return _expanded(read_content(file), str(file), file.parent)


def _expanded(data: bytes, source: str, directory: Path | None) -> RobotFile:
    """A file of XML, whose macros are expanded; descriptions do without what this needs."""
    from echelon.formats.robot_sources import expanded

    return RobotFile.of(expanded(data, source, directory), source, directory)


@public
def load(
    robot: Any,
    *,
    snap_tolerance: float = ANGLE_TOLERANCE,
    symbolic: bool = True,
    floating: bool = False,
    keep_fixed_links: bool = False,
    independent_mimics: bool = False,
    massless: Sequence[str] = (),
    gravity: Gravity = "file",
    separate_symbols: bool = False,
    measured: Measured = "drives",
    locked: Mapping[str, float] | None = None,
    ignore: Sequence[str] = (),
    model: str = "",
    experiment: str = "",
) -> Mechanism:
    """Read a robot description.

    Parameters
    ----------
    robot : path-like, str or model
        A URDF, SDF, MJCF, xacro or Echelon description file, where the content decides between XML formats; or the text
        of one; a ``mujoco.MjSpec`` or ``MjModel``; a ``pinocchio.Model``; or a name of the ``robot_descriptions``
        package, such as ``"panda_description"``.
    snap_tolerance : float
        Angles this near (rad) to a multiple of 15° and axes this near to a coordinate direction are read as exact; 0
        switches this off.
    symbolic : bool
        Give lengths of URDF and MJCF files symbols (``px4``: x offset of joint 4), or keep them as exact numbers, as
        with loops in any case.  Without symbols, those of a description become their values too; only angles without
        an exact sine stay symbols.
    floating : bool
        Let the root link float.
    keep_fixed_links : bool
        Keep links that are fixed to others as bodies with parameters of their own.
    independent_mimics : bool
        Ignore mimic elements and equality couplings, as most programs do.
    massless : sequence of str
        Links that carry no parameters.
    gravity : "file", "generic", None or 3 numbers or expressions
        Gravity in the base frame, m/s².
    separate_symbols : bool
        Give every number of a URDF or MJCF file a symbol of its own; otherwise equal magnitudes share one.
    measured : "drives" or "file"
        The outputs: the forces of all drives, or those of the sensors of an MJCF file (see
        ``docs/formats/mjcf.md``).  Descriptions state their outputs themselves.
    locked : mapping of str to float, optional
        Coordinates, or joints, that do not move, and where they stand, rad or m.
    ignore : sequence of str
        Elements (``"loop"``, ``"gazebo/joint"``) and attributes (``"@quat"``, ``"origin@quat"``) of a robot file that
        count as if they were not there.  What Echelon does not read is refused where it could change how the robot
        moves, unless it is listed here.
    model : str
        Name of the model to read from an SDF file in which several have joints.
    experiment : str
        Name of the one of a description's experiments that is read alone, with the robot's own names.

    Returns
    -------
    Mechanism

    Raises
    ------
    InputError
        If the file cannot be read or is not a valid robot; the message names file and element.

    Warns
    -----
    DoubtWarning
        If angles look like degrees, or offsets like millimetres.

    Examples
    --------
    >>> import echelon as ec
    >>> print(ec.load("examples/panda.yaml"))
    panda: 7 bodies, 7 degrees of freedom
    """
    options = ReadingOptions(
        snap_tolerance,
        symbolic,
        floating,
        keep_fixed_links,
        independent_mimics,
        tuple(massless),
        gravity,
        separate_symbols=separate_symbols,
        measured=measured,
        locked=locked or {},
        ignore=tuple(ignore),
        experiment=experiment,
    )
    return open_robot(robot, model).mechanism(options)


def load_model(robot: Any, model: str = "", **reading: Any) -> Mechanism | LinearModel:
    """Read a robot, with the keyword arguments of :func:`load`, or a linear model."""
    file = open_robot(robot, model)
    if not file.is_linear_model:
        return file.mechanism(ReadingOptions(**reading))
    from echelon.formats.linear_models import read_linear

    return read_linear(file.document)
