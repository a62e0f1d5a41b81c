"""Identified bodies that are far from what was believed of them.

Motions show combinations of masses and inertias, not each of them: a link of 245 kg may predict as well as one of 3 kg.
So nobody should load such a link into a simulator unwarned, whether the data mean it or only do not mind it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from echelon.arrays import Floats
from echelon.identification.physics.bounds import roles
from echelon.inertia.spatial import pseudo_inertia
from echelon.logs.finding import Finding, warning
from echelon.mechanism.mechanism import Mechanism

KIND = "far from the prior"
_FAR = 5.0
_SHOWN = 6


def departures(mechanism: Mechanism, standard: Floats, prior: Floats, weight: float) -> list[Finding]:
    """Bodies whose mass or inertia about the centre of mass is more than five times off; nan is unknown."""
    role = roles(mechanism)
    triples = zip(role.bodies, role.blocks(prior), role.blocks(standard), strict=True)
    found = [text for (name, _), before, after in triples for text in _changes(name, before, after)]
    if not found:
        return []
    more = f" and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
    body = found[0].split("'")[1]
    text = (
        f"identified bodies are more than {_FAR:g} times off their prior: {'; '.join(found[:_SHOWN])}{more}. Data may "
        "hardly see them alone: state what you know under 'identification', as total_mass: [least, most] or "
        f"bodies: {{{body}: {{mass: [least, most]}}}}, or a prior: {{weight: …}} above {weight:.3g}"
    )
    return [warning(KIND, "", text)]


def _changes(name: str, before: Floats, after: Floats) -> Iterator[str]:
    if not (np.isfinite(before).all() and before[9] > 0 and after[9] > 0):
        return
    if _is_far(before[9], after[9]):
        yield f"'{name}' {after[9]:.3g} kg for {before[9]:.3g} kg"
    first, second = (_spread(values) for values in (before, after))
    if first > 0 and _is_far(first, second):
        yield f"'{name}' {second:.2g} kg·m² about its centre for {first:.2g} kg·m²"


def _is_far(before: float, after: float) -> bool:
    return not 1 / _FAR <= after / before <= _FAR


def _spread(values: Floats) -> float:
    """Largest moment of inertia about an axis through the centre of mass."""
    pseudo = pseudo_inertia(values)
    second = np.linalg.eigvalsh(pseudo[:3, :3] - np.outer(values[6:9], values[6:9]) / values[9])
    return float(second[1] + second[2])
