"""All faults."""

from mutation import (
    base,
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
    *mechanism.FAULTS,
    *formats.FAULTS,
    *numerics.FAULTS,
    *data.FAULTS,
    *estimation.FAULTS,
)
