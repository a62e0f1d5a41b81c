"""All faults."""

from mutation import base, exact, formats, mechanism, program, regressor
from mutation.fault import Fault

FAULTS: tuple[Fault, ...] = (
    *exact.FAULTS,
    *program.FAULTS,
    *regressor.FAULTS,
    *base.FAULTS,
    *mechanism.FAULTS,
    *formats.FAULTS,
)
