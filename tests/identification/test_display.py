"""Results in a notebook."""

from __future__ import annotations

import sys

import numpy as np
import pandas as pd
import pytest

import echelon as ec
from support.swinging_arm import ARM, swinging


@pytest.fixture(scope="module")
def result() -> ec.Identification:
    motion = swinging()
    return ec.identify(
        ARM.replace("elbow_joint", "el&amp;bow"),
        {name: motion[name] for name in ("t", "q", "tau")},
    )


def test_parameters_are_a_data_frame(result: ec.Identification) -> None:
    frame = result.to_dataframe()
    assert isinstance(frame, pd.DataFrame)
    assert list(frame.index) == list(result.base.pivots)
    np.testing.assert_array_equal(frame["value"], result.values)
    assert (frame["low"] < frame["estimate"]).all()


def test_the_page_names_everything_safely(result: ec.Identification) -> None:
    page = result._repr_html_()
    assert "el&amp;bow" in page
    assert page.count("<tr>") == 2 + 2 + result.base.rank
    assert str(result.base.expressions[0]) in page


def test_measured_and_predicted_are_drawn(result: ec.Identification) -> None:
    lines = result.plot().data
    assert [line.name for line in lines] == ["measured", "predicted"] * 2
    np.testing.assert_allclose(lines[0].y, lines[1].y, atol=0.2)
    assert lines[0].line.color != lines[1].line.color


def test_absent_packages_name_the_extra(
    result: ec.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package in ("pandas", "plotly.graph_objects"):
        monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ec.MissingExtraError, match=r"echelon-robotics\[notebook\]"):
        result.to_dataframe()
    with pytest.raises(ec.MissingExtraError, match=r"echelon-robotics\[identify\]"):
        result.plot()
