"""All faults."""

from mutation import (
    base,
    comparison,
    data,
    estimation,
    exact,
    formats,
    mechanism,
    numerics,
    program,
    regressor,
)
from mutation.fault import Fault

FAULTS: tuple[Fault, ...] = (
    *exact.FAULTS,
    *program.FAULTS,
    *regressor.FAULTS,
    *base.FAULTS,
    *comparison.FAULTS,
    *mechanism.FAULTS,
    *formats.FAULTS,
    *numerics.FAULTS,
    *data.FAULTS,
    *estimation.FAULTS,
)
