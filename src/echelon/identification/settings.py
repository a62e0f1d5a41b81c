"""Settings of an identification: what is fitted, with which method, and what is known beforehand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from echelon.formats.robot_file import RobotFile
from echelon.logs.columns.column_map import ColumnMap
from echelon.logs.preparation.settings import Preparation
from echelon.mechanism.mechanism import Mechanism
from echelon.seeds import DEFAULT_SEED

if TYPE_CHECKING:
    from echelon.formats.schema.schema_excite import ExcitationEntry

Estimator = Literal["ols", "wls", "irls", "huber", "tls", "ridge", "iv"]
Predicting = Literal["estimate", "essential", "physical"]
Criterion = Literal["bic", "f-test", "relative_std", "none"]


def _nothing_stated() -> ExcitationEntry:
    from echelon.formats.schema.schema_excite import ExcitationEntry  # the library of schemas takes long to import

    return ExcitationEntry.model_validate({})


@dataclass(frozen=True)
class Settings:
    """What is fitted, and how.

    Attributes
    ----------
    estimator : str
        ``"ols"``, ``"wls"`` (noise of the outputs from separate fits), ``"irls"`` (the same, iterated), ``"huber"``,
        ``"tls"``, ``"ridge"`` (towards the prior) or ``"iv"`` (instruments from the reference positions).
    known : mapping of str to float
        Base parameters with known values, SI units.
    holdout : float
        Share of every log that is kept for validation where no other log is, 0 to 1.
    physical : bool
        Whether a physically consistent robot is fitted as well.
    predict : str
        Which values predictions use: ``"estimate"``, ``"essential"`` or ``"physical"``.
    essential : str
        Criterion of the backward elimination: ``"bic"``, ``"f-test"``, ``"relative_std"`` or ``"none"``.
    prior_weight : float, optional
        Of the prior against the data in the physical fit and in ridge; chosen from the data if None.
    bodies : mapping of str to mapping
        What :meth:`echelon.identification.physics.bounds.Bounds.of` takes: by body ``mass``, ``box``, ``ellipsoid`` and
        ``symmetry``.
    parameters : mapping of str to (float, float)
        Bounds on standard parameters by name.
    total_mass : (float, float), optional
        Range of the mass of all bodies together, kg.
    intervals : "clustered" or "classical"
        Covariance from batches of time, which holds where residuals are not white, or the classical one.
    level : float
        Of confidence intervals.
    seed : int
    """

    estimator: Estimator = "irls"
    known: Mapping[str, float] = field(default_factory=dict)
    holdout: float = 0.3
    physical: bool = True
    predict: Predicting = "estimate"
    essential: Criterion = "bic"
    prior_weight: float | None = None
    bodies: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    total_mass: tuple[float, float] | None = None
    intervals: Literal["clustered", "classical"] = "clustered"
    level: float = 0.95
    seed: int = DEFAULT_SEED


@dataclass(frozen=True)
class Setup:
    """A robot, what its logs mean, and what is to be done with them.

    Attributes
    ----------
    source : str
        The file that states it.
    mechanism : Mechanism
    columns : tuple of ColumnMap
        What columns mean, for one or several kinds of logs; none where the file does not say, then the columns' names
        must speak for themselves.
    preparation : Preparation
    settings : Settings
    prior : Mechanism, optional
        Another description of the robot, with inertial values that are believed beforehand.
    robot_file : RobotFile, optional
        The URDF, SDF or MJCF file that holds the robot, if one does.
    assumed : tuple of str
        What was taken for granted where the file is silent, in sentences.
    excitation : ExcitationEntry
        What a trajectory has to keep that excites the parameters; see :func:`echelon.exciting_trajectory`.
    """

    source: str
    mechanism: Mechanism
    columns: tuple[ColumnMap, ...] = ()
    preparation: Preparation = field(default_factory=Preparation)
    settings: Settings = field(default_factory=Settings)
    prior: Mechanism | None = None
    robot_file: RobotFile | None = None
    assumed: tuple[str, ...] = ()
    excitation: ExcitationEntry = field(default_factory=_nothing_stated)
