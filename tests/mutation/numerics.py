"""Faults in machine code, dynamics, observations, generated source, inertias and linear models."""

from mutation.fault import Fault

RECURSION, COMPOSITE, OPERATIONS = (
    "dynamics/recursion.py",
    "dynamics/composite.py",
    "compute/machine/operations_text.py",
)
DYNAMICS = "dynamics/test_dynamics.py dynamics/test_evaluation.py"
TRIGONOMETRY, BATCHES = (
    "machine/test_machine_operations.py",
    "machine/test_machine_batches.py",
)
TRIANGLE, OBSERVE = (
    "observe/test_observe_triangle.py",
    "observe/test_observe.py observe/test_observe_algebra.py",
)
CODE = "codegen/test_codegen.py codegen/test_codegen_text.py"
CONVERT = "inertia/test_convert.py"

FAULTS = (
    Fault(
        "compute/tensors.py",
        "columns |= {node: array[..., k]",
        "columns |= {node: array[..., 0]",
        "every entry is the first one",
        "machine/test_tensors.py",
    ),
    Fault(
        RECURSION,
        "xy - dz, xz + dy]",
        "xy + dz, xz + dy]",
        "angular acceleration in the field",
        DYNAMICS,
    ),
    Fault(
        RECURSION,
        "add(coriolis, coriolis)",
        "coriolis",
        "half of the Coriolis acceleration",
        DYNAMICS,
    ),
    Fault(RECURSION, "(-gx, -gy, -gz)", "(-gx, -gy, gz)", "sense of gravity", DYNAMICS),
    Fault(
        RECURSION,
        "add(moment, cross(step.shift, force))",
        "moment",
        "moments of forces at a distance",
        DYNAMICS,
    ),
    Fault(
        RECURSION,
        "- u[i][k] * inertia[j, k]",
        "+ u[i][k] * inertia[j, k]",
        "products of inertia",
        DYNAMICS,
    ),
    Fault(
        COMPOSITE,
        "(first[i] + later) * shift[i] if i == j",
        "2 * first[i] * shift[i] if i == j",
        "the square of the distance in a composite inertia",
        DYNAMICS,
    ),
    Fault(
        COMPOSITE,
        "cross(angular, first))",
        "cross(first, angular))",
        "force of an angular acceleration",
        DYNAMICS,
    ),
    Fault(
        "dynamics/outputs.py",
        "(-along if k == axis",
        "(along if k == axis",
        "offsets along axes, which cost operations",
        "dynamics/test_dynamics.py",
    ),
    Fault(
        "dynamics/kinematics.py",
        "add(shift, apply(rotation, step.shift))",
        "add(shift, step.shift)",
        "origins of frames behind turned ones",
        "dynamics/test_kinematics.py",
    ),
    Fault(
        OPERATIONS,
        "v.of_integer(62)",
        "v.of_integer(63)",
        "signs of sines in other quadrants",
        TRIGONOMETRY,
    ),
    Fault(
        OPERATIONS,
        "v.of(LARGEST_ANGLE)",
        "v.of(1e300)",
        "sines of huge angles",
        TRIGONOMETRY,
    ),
    Fault(
        OPERATIONS,
        "{nonzero}, {v.type} {one}, {v.type} {a}",
        "{other}, {v.type} {one}, {v.type} {a}",
        "the sign of what is no number",
        "machine/test_machine_operations.py",
    ),
    Fault(
        "compute/machine/kernel.py",
        "min(first + size, samples)",
        "min(first + size - 1, samples)",
        "the last sample of a piece",
        BATCHES,
    ),
    Fault(
        "compute/machine/kernel.py",
        "strides[1] == DOUBLE or",
        "strides[1] >= DOUBLE or",
        "columns with gaps",
        "machine/test_machine_arrays.py",
    ),
    Fault(
        "compute/observe/triangle.py",
        "np.diagonal(R) < 0, -1.0",
        "np.diagonal(R) < 0, 1.0",
        "signs of R",
        TRIANGLE,
    ),
    Fault(
        "compute/observe/triangle.py",
        "max(self.rows, len(self.parameters))",
        "self.rows**2",
        "where a singular value counts as zero",
        f"{TRIANGLE} {OBSERVE}",
    ),
    Fault(
        "compute/observe/accumulate.py",
        "number + k) for k in range(0, whole, length)",
        "k) for k in range(0, whole, length)",
        "the number of a sample that is not finite",
        OBSERVE,
    ),
    Fault(
        "compute/observe/observation.py",
        "/ safe[:, None] / safe)",
        "/ safe[:, None])",
        "normal equations",
        OBSERVE,
    ),
    Fault(
        "codegen/views.py", "_at_least(Binding.PRODUCT, b)", "b[0]", "a − (b + c)", CODE
    ),
    Fault("codegen/views.py", "_at_least(Binding.ATOM, b)", "b[0]", "a / (b·c)", CODE),
    Fault(
        "codegen/language.py",
        "Op.ABS: 'ca.fabs({x})'",
        "Op.ABS: 'ca.sign({x})'",
        "absolute values in CasADi",
        CODE,
    ),
    Fault(
        "codegen/views.py",
        "range(0, self.places, LANES)",
        "range(0, LANES, LANES)",
        "blocks of angles",
        CODE,
    ),
    Fault(
        "robot/inertia.py",
        "(square - centre[..., :, None]",
        "(square + centre[..., :, None]",
        "Steiner",
        CONVERT,
    ),
    Fault(
        "robot/inertia.py",
        "_M, _MX, _MY, _MZ, _XX, _XY, _YY, _XZ",
        "_M, _MX, _MY, _MZ, _XX, _XY, _XZ, _YY",
        "Pinocchio's order",
        CONVERT,
    ),
    Fault(
        "robot/inertia.py",
        "array[..., 2, 4], array[..., 0, 5]",
        "array[..., 2, 4], array[..., 0, 4]",
        "first moments of a spatial inertia",
        CONVERT,
    ),
    Fault(
        "robot/inertia.py",
        "orders[0].index(k) for k in orders[1]",
        "orders[1].index(k) for k in orders[0]",
        "order of regressor columns",
        CONVERT,
    ),
    Fault(
        "dynamics/models.py",
        "{**model.values, **(constants or {}), **variables}",
        "{**(constants or {}), **model.values, **variables}",
        "constants that are given",
        "base/test_linear_model.py",
    ),
    Fault(
        "dynamics/models.py",
        "f'y{i + 1}'",
        "f'y{i}'",
        "names of outputs",
        "base/test_linear_model.py",
    ),
)
