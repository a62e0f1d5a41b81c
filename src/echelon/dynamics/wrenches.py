"""The wrench that a body's motion needs, with few operations.

With the pseudo-inertia [[Σ, h], [hᵀ, m]] and U = ω̂̇ + ω̂² the force is m a + U h and the moment h × a + vee(U Σ).  The
entries of U are at hand from the motion of the next body's origin.  What vanishes or is uniform is used: each component
of the moment has a pair of terms that can be written with Σ and U, or with the inertia tensor, ω̇ and ω ωᵀ.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from echelon.inertia.spatial import Array
from echelon.program.tape import Scalar
from echelon.regressor.spatial import Mat, Vec, add, apply, cross, scale

Wrench = tuple[Vec, Vec]
"""Moment about the frame's origin and force."""


@dataclass(frozen=True, eq=False)
class Kinematics:
    """How a frame moves, in its own axes; another frame is another object, even if it moves alike.

    Attributes
    ----------
    angular, angular_rate : 3 of Scalar
        Angular velocity and acceleration.
    linear : 3 of Scalar
        Acceleration of the origin, minus gravity.
    along : (int, 3 of Scalar), optional
        An axis, and what the field has across it in the axis's column, where a simpler form than the sum is known.
    """

    angular: Vec
    angular_rate: Vec
    linear: Vec
    along: tuple[int, Vec] | None = None

    @cached_property
    def products(self) -> Mat:
        """ω ωᵀ."""
        x, y, z = self.angular
        return (scale(self.angular, x), scale(self.angular, y), scale(self.angular, z))

    @cached_property
    def field(self) -> Mat:
        """U = ω̂̇ + ω̂²: the point at r accelerates by U r against the origin."""
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = self.products
        dx, dy, dz = self.angular_rate
        rows = [[-(yy + zz), xy - dz, xz + dy], [xy + dz, -(xx + zz), yz - dx], [xz - dy, yz + dx, -(xx + yy)]]
        if self.along is not None:
            axis, column = self.along
            for k in range(3):
                rows[k][axis] = rows[k][axis] if k == axis else column[k]
        (a, b, c), (d, e, f), (g, h, i) = rows
        return ((a, b, c), (d, e, f), (g, h, i))


def body_wrench(at: Kinematics, inertia: Array) -> Wrench:
    """Wrench about the body's origin that its motion needs.

    Parameters
    ----------
    at : Kinematics
        Of the body's frame.
    inertia : array of shape (4, 4) of Scalar
        Pseudo-inertia about that frame.
    """
    first: Vec = (inertia[0, 3], inertia[1, 3], inertia[2, 3])
    force = add(apply(at.field, first), scale(at.linear, inertia[3, 3]))
    x, y, z = (_moment(at, inertia, *axes) for axes in ((1, 2, 0), (2, 0, 1), (0, 1, 2)))
    return add((x, y, z), cross(first, at.linear)), force


def _moment(at: Kinematics, inertia: Array, i: int, j: int, k: int) -> Scalar:
    """Component k of vee(U Σ)."""
    u = at.field
    mixed = (u[j][j] - u[i][i]) * inertia[i, j] + u[j][k] * inertia[i, k] - u[i][k] * inertia[j, k]
    return sum(_pair(at, inertia, i, j, k), mixed)


def _pair(at: Kinematics, inertia: Array, i: int, j: int, k: int) -> list[Scalar]:
    """U_ji Σ_ii − U_ij Σ_jj = ω̇_k (Σ_ii + Σ_jj) + ω_i ω_j (Σ_ii − Σ_jj), with as few terms as possible."""
    u, a, b = at.field, inertia[i, i], inertia[j, j]
    moments = [u[j][i] * a, -u[i][j] * b]
    tensor = [at.angular_rate[k] * (a + b), at.products[i][j] * (a - b)]
    first, second = ([term for term in form if not term.is_zero] for form in (moments, tensor))
    return first if len(first) < len(second) else second
