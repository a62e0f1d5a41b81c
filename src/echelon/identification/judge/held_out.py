"""Blocks of time that are predicted from one another, by a model and by a model with columns of a hypothesis.

A model with the columns W of its parameters and columns X of a hypothesis is fitted by least squares, outputs weighted
by their noise, to all blocks but one, and the one left out is predicted.  What it leaves of each output in each block
says how good the hypothesis is, and how sure that is: blocks err independently where samples do not.

W is projected away once for each block, so that a hypothesis costs no more than its own few columns.  With
β = (WᵀW)⁻¹Wᵀ X and the residuals r = y − W (WᵀW)⁻¹Wᵀ y of all other blocks, the parameters of X are those of least
squares of r by X − W β.  Of the block left out only the products of these, [r X − Wβ]ᵀ[r X − Wβ], are needed, from
which residuals with any of the columns follow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from echelon.identification.judge.evidence import (
    BLOCKS,
    OutputRows,
    Products,
    States,
    ridged_inverse,
    ridged_solution,
    width,
)
from echelon.shared import Floats, Integers

_OTHERS = 1 - np.eye(BLOCKS)  # sums over all blocks but one


class HeldOut:
    """Predictions of each block from all others by a model.

    Parameters
    ----------
    products : Products
        Of the model.
    noise : array of shape (outputs,)
        Variances by which outputs are weighted.
    """

    def __init__(self, products: Products, noise: Floats) -> None:
        self.products, self.weights = products, 1 / noise
        values, inverses = [], []
        for block in range(BLOCKS):
            others = products.together(
                [other for other in range(BLOCKS) if other != block]
            )
            matrix, right = others.normal_equations(self.weights)
            values.append(ridged_solution(matrix, right))
            inverses.append(ridged_inverse(matrix))
        self.values = np.array(
            values
        )  # shape (blocks, parameters), those fitted without each block
        self.inverses = np.array(
            inverses
        )  # shape (blocks, parameters, parameters), of normal matrices

    @cached_property
    def squares(self) -> Floats:
        """Squares of what is left of each block, shape (blocks, outputs)."""
        blocks = range(BLOCKS)
        return np.concatenate(
            [self.products.together([k]).squares(self.values[k]) for k in blocks]
        )


class Beside:
    """Predictions of each block from all others by a model and columns of some terms.

    Parameters
    ----------
    held : HeldOut
        Predictions by the model alone.
    rows : sequence of OutputRows
        The rows of the model, output by output.
    states : States
        Where these are from.
    terms : sequence of mappings
        Signals (samples, k) by output; their columns are numbered in this order.
    """

    def __init__(
        self,
        held: HeldOut,
        rows: Sequence[OutputRows],
        states: States,
        terms: Sequence[Mapping[int, Floats]],
    ) -> None:
        self._held = held
        self._numbers, self._products = _with_columns(rows, states, terms)
        count, model = sum(map(width, terms)), held.products
        cross = np.zeros((BLOCKS, model.size, count))  # WᵀX of all blocks but one
        own = np.zeros((BLOCKS, count, count))  # XᵀX
        right = np.zeros((BLOCKS, count))  # Xᵀy
        for output, numbers in self._numbers.items():
            columns, size = model.columns[output], len(model.columns[output])
            others = held.weights[output] * np.tensordot(
                _OTHERS, self._products[output], 1
            )
            cross[:, columns[:, None], numbers] += others[:, :size]
            right[:, numbers] += others[:, size]
            own[:, numbers[:, None], numbers] += others[:, size + 1 :]
        self._shadows = held.inverses @ cross  # β, shape (blocks, parameters, columns)
        self._left = own - cross.transpose(0, 2, 1) @ self._shadows
        self._rest = right - np.einsum("bpc,bp->bc", cross, held.values)
        self._squares_of_columns = np.einsum("bcc->bc", own)

    @cached_property
    def new(self) -> Floats:
        """Shares of columns' squares that the model cannot say already, at least over the blocks, shape (columns,)."""
        whole = np.maximum(self._squares_of_columns, np.finfo(float).tiny)
        return np.asarray((np.einsum("bcc->bc", self._left) / whole).min(axis=0))

    def sizes(self, columns: Sequence[int]) -> Floats:
        """Parameters of some columns, the mean over the blocks, shape (columns,)."""
        return np.asarray(self._fitted(columns).mean(axis=0))

    def squares(self, columns: Sequence[int]) -> Floats:
        """Squares of what is left of each block with some of the columns, shape (blocks, outputs)."""
        ahead = np.insert(-self._fitted(columns), 0, 1.0, axis=1)
        some = np.array([0, *(1 + column for column in columns)])
        found = np.empty((BLOCKS, len(self._residual_products)))
        for output, products in enumerate(self._residual_products):
            left = products[:, some[:, None], some]
            found[:, output] = np.einsum("bi,bij,bj->b", ahead, left, ahead)
        return np.maximum(found, 0.0)

    def _fitted(self, columns: Sequence[int]) -> Floats:
        """Parameters of some columns that are fitted without each block, shape (blocks, columns)."""
        some = np.array(columns, dtype=np.intp)
        pairs = zip(self._left, self._rest, strict=True)
        return np.array(
            [
                ridged_solution(left[np.ix_(some, some)], rest[some])
                for left, rest in pairs
            ]
        )

    @cached_property
    def _residual_products(self) -> list[Floats]:
        """[r X − Wβ]ᵀ[r X − Wβ] in the blocks left out, of each output; shape (blocks, 1 + columns, 1 + columns)."""
        model = self._held.products
        of_model = np.concatenate(
            [self._held.values[:, :, None], self._shadows], axis=2
        )
        found = []
        for output, (columns, gram) in enumerate(
            zip(model.columns, model.grams, strict=True)
        ):
            ahead = np.zeros(
                (BLOCKS, len(columns) + 1, of_model.shape[2])
            )  # r and X − Wβ by the columns of W and y
            ahead[:, :-1] = -of_model[:, columns]
            ahead[:, -1, 0] = 1.0
            back = ahead.transpose(0, 2, 1)
            products = back @ (gram @ ahead)
            if output in self._numbers:
                added = 1 + self._numbers[output]
                size = len(columns) + 1
                mixed = back @ self._products[output][:, :size]
                products[:, :, added] += mixed
                products[:, added, :] += mixed.transpose(0, 2, 1)
                products[:, added[:, None], added] += self._products[output][:, size:]
            found.append(products)
        return found


def _with_columns(
    rows: Sequence[OutputRows], states: States, terms: Sequence[Mapping[int, Floats]]
) -> tuple[dict[int, Integers], dict[int, Floats]]:
    """Columns X of terms and products [W y X]ᵀX in each block, by the outputs that they act on."""
    signals: dict[int, list[Floats]] = {}
    numbers: dict[int, list[int]] = {}
    first = 0
    for term in terms:
        following = first + width(term)
        for output, values in term.items():
            signals.setdefault(output, []).append(values)
            numbers.setdefault(output, []).extend(range(first, following))
        first = following
    filtered = states.rows(
        np.hstack([values for some in signals.values() for values in some])
    )
    ends = np.cumsum([len(some) for some in numbers.values()])
    products = {}
    for output, columns in zip(
        signals, np.split(filtered, ends[:-1], axis=1), strict=True
    ):
        model, X = rows[output], columns[rows[output].fitted]
        products[output] = model.products(np.hstack([model.table, X]), X)
    return {output: np.array(some) for output, some in numbers.items()}, products
