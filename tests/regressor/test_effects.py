"""Terms of effects, as the regressor and the base parameters hold them."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from echelon.formats.snapping import ReadingOptions
from support.descriptions import read_description

PENDULUM = """
echelon: 1
name: pendulum
gravity: [0, -9.81, 0]
symbols: {{phi: 0.3}}
modified_dh: [{{joint: revolute}}, {{joint: revolute, a: 0.5}}]
effects: [{{parameter: S, unit: N·m, acts: [{{at: j1, term: "{term}"}}]}}]
"""


@pytest.mark.parametrize(
    ("term", "phase"),
    [
        ("sin(q + 0.0872665)", 0.0872665),
        ("sin(q - 5*pi/180)", -np.pi / 36),
        ("sin(q + 0.1 - pi/7 + 0.2)", 0.3 - np.pi / 7),
        ("cos(q + 1.234567)", np.pi / 2 + 1.234567),
        ("sin(q + phi)", 0.3),
        ("sin(q - 2*phi)", -0.6),
    ],
)
def test_springs_with_any_phase_count_to_the_first_moments(
    term: str, phase: float
) -> None:
    """S sin(q + φ) is what a first moment does under gravity: g (MX cos q − MY sin q)."""
    mechanism = read_description(
        PENDULUM.format(term=term), "pendulum.yaml", ReadingOptions()
    )
    base = ec.base_parameters(mechanism)
    assert base.pivots == ("ZZ1", "MX1", "MY1", "ZZ2", "MX2", "MY2")
    seen = base.B_float()[1:3, base.parameters.index("S")]
    np.testing.assert_allclose(
        seen, np.array([np.sin(phase), -np.cos(phase)]) / 9.81, rtol=0, atol=1e-15
    )


def test_a_phase_does_not_matter_at_other_harmonics() -> None:
    base = ec.base_parameters(
        read_description(
            PENDULUM.format(term="sin(6*q + 0.3)"), "pendulum.yaml", ReadingOptions()
        )
    )
    q = np.linspace(-1, 1, 7)[:, None] * [1.0, 0.0]
    at_rest = base.regressor(q, 0 * q, 0 * q)[:, 0, base.pivots.index("S")]
    np.testing.assert_allclose(at_rest, np.sin(6 * q[:, 0] + 0.3), atol=1e-14)
