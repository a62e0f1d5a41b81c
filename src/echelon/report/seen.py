"""What the sensors can see of each body: its ten standard parameters, class by class."""

from __future__ import annotations

from dataclasses import dataclass

from echelon.base.base_set import Identifiability
from echelon.base.model import BaseModel
from echelon.conventions import PARAMETERS, PER_BODY
from echelon.errors import one_line

CLASSES = {
    Identifiability.ALONE: "alone",
    Identifiability.COMBINATION: "combined",
    Identifiability.UNIDENTIFIABLE: "unseen",
}
"""Names of the classes in style sheets."""


@dataclass(frozen=True)
class SeenBody:
    """One body."""

    index: int  # in ``mechanism.bodies``
    label: str
    name: str
    cells: tuple[str, ...]  # for XX … M a value of :data:`CLASSES`; empty for what it does not carry
    parameters: tuple[tuple[str, tuple[str, ...]], ...]  # shape (str, tuple of str): class → names of its parameters

    @property
    def level(self) -> int:
        """How much of it is seen: 0 nothing, 1 to 3 in thirds, 4 everything."""
        carried = sum(1 for cell in self.cells if cell)
        seen = sum(1 for cell in self.cells if cell in ("alone", "combined"))
        if seen in (0, carried):
            return 4 if seen else 0
        return min(1 + 3 * seen // carried, 3)

    @property
    def counts(self) -> dict[str, int]:
        """Number of parameters in each class."""
        return {kind: len(names) for kind, names in self.parameters}

    @property
    def words(self) -> str:
        """All in one sentence."""
        known = {"alone": "alone", "combined": "in combination", "unseen": "not at all"}
        parts = [f"{known[kind]}: {', '.join(names)}" for kind, names in self.parameters if names]
        return one_line(f"{self.name} (link {self.label}) – {'; '.join(parts)}")


def seen_bodies(base: BaseModel) -> list[SeenBody]:
    """All bodies that carry parameters, base to tip."""
    classes = [CLASSES[kind] for kind in base.classification.values()]
    found = []
    for index in base.mechanism.carriers:
        body, first = base.mechanism.bodies[index], base.mechanism.first_column[index]
        own = {kind: classes[first + k] for k, kind in enumerate(body.carried)}
        names = {kind: tuple(f"{PARAMETERS[k]}" for k in own if own[k] == kind) for kind in CLASSES.values()}
        cells = tuple(own.get(k, "") for k in range(PER_BODY))
        found.append(
            SeenBody(index, body.label, one_line(base.mechanism.carrier_name(index)), cells, tuple(names.items()))
        )
    return found
