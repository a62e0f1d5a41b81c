"""Predictions use physical values where unseen motions need what the fitted ones hardly show, and say so."""

from __future__ import annotations

import numpy as np

import echelon as ec
from support.swinging_arm import ARM, Motion, swinging

FEW = 600  # samples, of 2 s


def small(log: Motion) -> Motion:
    """The beginning of a log, in which the elbow hardly moves."""
    short = {name: values[:FEW].copy() for name, values in log.items()}
    base = ec.base_parameters(ec.load_setup(ARM).mechanism)
    q, t = short["q"], short["t"]
    q[:, 0] = 0.02 * np.sin(4 * t)
    q[:, 1] = 0.5 + 0.01 * np.cos(7 * t)
    qd, qdd = (
        np.gradient(q, t, axis=0),
        np.gradient(np.gradient(q, t, axis=0), t, axis=0),
    )
    standard = [
        0.2 if value is None else value
        for value in ec.load_setup(ARM).mechanism.standard_values()
    ]
    short["qd"] = qd
    short["tau"] = base.predict(q, qd, qdd, base.values(standard))
    short["tau"] += 0.05 * np.random.default_rng(3).normal(size=q.shape)
    return short


def test_an_estimate_that_unseen_motions_need_and_data_do_not_show_gives_way() -> None:
    fitted, unseen = small(swinging()), swinging()
    chosen = ec.identify(ARM, fitted, unseen)
    assert chosen.predict_with == "physical"
    (said,) = [found.text for found in chosen.findings if found.kind == "predictions"]
    assert "the fitted motions hardly excite some combinations" in said
    asked = ec.identify(
        ec.load_setup(ARM).with_settings(predict="estimate"), fitted, unseen
    )
    assert asked.predict_with == "estimate"
    pairs = zip(chosen.pooled[-1].scores, asked.pooled[-1].scores, strict=True)
    assert all(physical.rms < plain.rms for physical, plain in pairs)


def test_an_estimate_that_data_tell_is_used() -> None:
    result = ec.identify(ARM, swinging())
    assert result.predict_with == "estimate"
    assert not [found for found in result.findings if found.kind == "predictions"]
