"""Python with NumPy: functions of arrays with any leading axes."""

from __future__ import annotations

from echelon.codegen.language import Language
from echelon.codegen.numbers import Precision
from echelon.program.operations import Op

PYTHON = Language(
    name="python",
    files={"{robot}.py": "python.py.j2"},
    comment="# ",
    functions={
        Op.SIN: "np.sin({x})",
        Op.COS: "np.cos({x})",
        Op.TAN: "np.tan({x})",
        Op.EXP: "np.exp({x})",
        Op.LOG: "np.log({x})",
        Op.TANH: "np.tanh({x})",
        Op.SQRT: "np.sqrt({x})",
        Op.ABS: "np.abs({x})",
        Op.SIGN: "np.sign({x})",
        Op.ATAN: "np.arctan({x})",
    },
    real={Precision.DOUBLE: "np.float64", Precision.SINGLE: "np.float32"},
    entry="out[{index}]",
    separator=", ",
    zeroed=True,
)
