"""Base parameters of a linear model as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from echelon.base.linear_base import LinearBase
from echelon.program.sympy_bridge import to_sympy
from echelon.version import __version__

SCHEMA_NAME = "echelon.linear-base/1"


def linear_to_json(base: LinearBase) -> str:
    """The set as JSON text; equal sets give equal text."""
    return json.dumps(linear_to_dict(base), indent=1, ensure_ascii=False) + "\n"


def linear_to_dict(base: LinearBase) -> dict[str, Any]:
    """The set as JSON-able data; ``model`` is a document that :func:`echelon.load_linear` reads."""
    evidence = {k: str(v) if isinstance(v, int) and v > 2**53 else v for k, v in asdict(base.certificate).items()}
    if "identity_primes" in evidence:
        evidence["identity_primes"] = [str(p) for p in evidence["identity_primes"]]
    classes: dict[str, list[str]] = {}
    for name, kind in base.classification.items():
        classes.setdefault(kind.value, []).append(name)
    return {
        "schema": SCHEMA_NAME,
        "echelon": __version__,
        "name": base.model.name,
        "seed": base.seed,
        "route": base.route,
        "rank": base.rank,
        "parameters": list(base.parameters),
        "base": _rows(base),
        "definitions": dict(base.definitions),
        "classification": classes,
        "special": None if base.special is None else asdict(base.special),
        "certificate": evidence,
        "model": _document(base),
    }


def _rows(base: LinearBase) -> list[dict[str, Any]]:
    rows = []
    for expression, row in zip(base.expressions, base.matrix.rows, strict=True):
        terms = [
            {"parameter": base.parameters[c], "coefficient": str(v.numerator), "denominator": str(v.denominator)}
            for c, v in sorted(row.items())
        ]
        rows.append({"name": expression.name, "unit": expression.unit, "expression": str(expression), "terms": terms})
    return rows


def _document(base: LinearBase) -> dict[str, Any]:
    model, forms = base.model, base.model.regressor
    texts = [_text(e) for e in to_sympy(forms.program, list(forms.entries.values()))]
    table = [["0"] * forms.shape[1] for _ in range(forms.shape[0])]
    for (i, j), text in zip(forms.entries, texts, strict=True):
        table[i][j] = text
    return {
        "echelon": "1",
        "model": "linear",
        "name": model.name,
        "variables": list(model.variables),
        "parameters": dict(zip(model.parameters, model.units, strict=True)),
        "constants": {n: None if v is None else str(v) for n, v in model.constants.items()},
        "regressor": dict(zip(model.outputs, table, strict=True)),
    }


def _text(formula: Any) -> str:
    """A sympy formula in the grammar of :mod:`echelon.program.text`."""
    import sympy

    return str(formula.subs(sympy.E, sympy.Function("exp")(sympy.Symbol("1")))).replace("Abs(", "abs(")
