"""Where one frame sits in another: a constant rotation and translation with exact entries."""

from __future__ import annotations

from dataclasses import dataclass

from echelon.exact.angle import Angle
from echelon.exact.polynomial import Polynomial, as_polynomial

Vector = tuple[Polynomial, Polynomial, Polynomial]
Matrix = tuple[Vector, Vector, Vector]

_ZERO, _ONE = Polynomial({}), Polynomial.constant(1)
ORIGIN: Vector = (_ZERO, _ZERO, _ZERO)
IDENTITY: Matrix = ((_ONE, _ZERO, _ZERO), (_ZERO, _ONE, _ZERO), (_ZERO, _ZERO, _ONE))


@dataclass(frozen=True)
class Placement:
    """A frame placed in a reference frame: x_reference = rotation · x + translation."""

    rotation: Matrix = IDENTITY  # columns are the placed frame's axes in the reference frame
    translation: Vector = ORIGIN  # origin of the placed frame in the reference frame, m

    @property
    def is_identity(self) -> bool:
        """Whether both frames coincide."""
        return self.rotation == IDENTITY and self.translation == ORIGIN

    def __matmul__(self, other: Placement) -> Placement:
        """Composition: a placement that is given in this frame, in the frame that this placement is given in."""
        if self.is_identity or other.is_identity:
            return other if self.is_identity else self
        moved = rotate(self.rotation, other.translation)
        x, y, z = (a + b for a, b in zip(self.translation, moved, strict=True))
        return Placement(multiply(self.rotation, other.rotation), (x, y, z))

    def inverse(self) -> Placement:
        """The reference frame placed in this one."""
        back = transpose(self.rotation)
        x, y, z = rotate(back, self.translation)
        return Placement(back, (-x, -y, -z))

    def entries(self) -> list[Polynomial]:
        """All entries, those of the translation last."""
        return [*(entry for row in self.rotation for entry in row), *self.translation]

    def symbols(self) -> list[str]:
        """Geometry symbols that occur."""
        return sorted({s for e in self.entries() for s in e.symbols()})


def shift(x: Polynomial | int, y: Polynomial | int, z: Polynomial | int) -> Placement:
    """A pure translation."""
    return Placement(IDENTITY, (as_polynomial(x), as_polynomial(y), as_polynomial(z)))


def turn(axis: int, angle: Angle) -> Placement:
    """A rotation about coordinate axis 0, 1 or 2 (x, y, z) by an exact angle."""
    return turn_by(axis, angle.cos(), angle.sin())


def turn_by(axis: int, c: Polynomial, s: Polynomial) -> Placement:
    """A rotation about a coordinate axis by the cosine and sine of an angle."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    entries = [list(row) for row in IDENTITY]
    entries[i][i], entries[i][j], entries[j][i], entries[j][j] = c, -s, s, c
    return Placement(as_matrix(entries))


def as_matrix(entries: list[list[Polynomial]]) -> Matrix:
    """Nested lists as the tuple form."""
    (a, b, c), (d, e, f), (g, h, i) = entries
    return ((a, b, c), (d, e, f), (g, h, i))


def rotate(matrix: Matrix, vector: Vector) -> Vector:
    """Matrix times vector."""
    x, y, z = (Polynomial.sum(a * b for a, b in zip(row, vector, strict=True) if a and b) for row in matrix)
    return (x, y, z)


def multiply(left: Matrix, right: Matrix) -> Matrix:
    """Matrix product."""
    columns = transpose(right)
    return transpose((rotate(left, columns[0]), rotate(left, columns[1]), rotate(left, columns[2])))


def transpose(matrix: Matrix) -> Matrix:
    """Transpose, which for a rotation is the inverse."""
    (a, b, c), (d, e, f), (g, h, i) = matrix
    return ((a, d, g), (b, e, h), (c, f, i))
