"""Topics with clocks of their own come onto one clock."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from echelon.identification.logs.columns.column_map import Channel, ColumnMap
from echelon.identification.logs.columns.conversion import recording
from echelon.identification.logs.files.log_file import Table
from support.column_maps import PENDULUM, channels


def bag(shift: float = 0.0) -> Table:
    states, wrench = np.arange(0, 2, 0.01), np.arange(0.3, 1.5, 0.004) + shift
    return Table(
        "bag",
        {
            "/s/time": states,
            "/s/q1": np.sin(states),
            "/s/q2": np.cos(states),
            "/w/time": wrench,
            "/w/t1": 2 * wrench + 1,
            "/w/t2": -wrench,
        },
        {
            "/s/q1": "/s/time",
            "/s/q2": "/s/time",
            "/w/t1": "/w/time",
            "/w/t2": "/w/time",
        },
    )


TOPICS = ColumnMap(
    positions=channels("/s/q{n}", ["j1", "j2"]),
    outputs=channels("/w/t{n}", ["j1", "j2"]),
)


def test_topics_come_onto_the_clock_of_the_positions() -> None:
    found = recording(bag(), TOPICS, PENDULUM)
    wrench = bag().columns["/w/time"]
    assert found.time[0] >= wrench[0]
    assert found.time[-1] <= wrench[-1]
    assert np.allclose(np.diff(found.time), 0.01)
    assert np.array_equal(found.signals["q"][:, 0], np.sin(found.time))
    assert np.allclose(
        found.signals["y"],
        np.stack([2 * found.time + 1, -found.time], axis=1),
        atol=1e-12,
    )


def test_topics_are_not_made_up_in_pauses_or_beyond_their_ends() -> None:
    table = bag()
    keep = (table.columns["/w/time"] < 0.8) | (table.columns["/w/time"] > 1.0)
    cut = {
        name: values[keep] if name.startswith("/w") else values
        for name, values in table.columns.items()
    }
    found = recording(Table("bag", cut, table.clocks), TOPICS, PENDULUM)
    pause = np.isnan(found.signals["y"]).all(axis=1)
    stamps = cut["/w/time"]
    ends = stamps[stamps < 0.9].max(), stamps[stamps > 0.9].min()
    assert np.array_equal(pause, (found.time > ends[0]) & (found.time < ends[1]))
    assert 18 <= pause.sum() <= 21
    assert not np.isnan(found.signals["q"]).any()
    with pytest.raises(ec.InputError, match="no time in common"):
        recording(bag(10.0), TOPICS, PENDULUM)
    back = dict(table.columns)
    back["/w/time"] = back["/w/time"].copy()
    back["/w/time"][50] = 0.0
    with pytest.raises(
        ec.InputError, match="'/w/t1': its time stamps go backwards at row 50"
    ):
        recording(Table("bag", back, table.clocks), TOPICS, PENDULUM)


def test_a_time_column_may_replace_the_stamps_of_its_own_topic() -> None:
    table = bag()
    stamp = {"/s/stamp": table.columns["/s/time"] * 1e3 + 7}
    clocks = {**table.clocks, "/s/stamp": "/s/time"}
    columns = ColumnMap(
        time=Channel("/s/stamp", "ms", offset=-0.007),
        positions=TOPICS.positions,
        outputs=TOPICS.outputs,
    )
    found = recording(
        Table("bag", {**table.columns, **stamp}, clocks), columns, PENDULUM
    )
    assert np.allclose(found.signals["q"][:, 0], np.sin(found.time), atol=1e-12)
    assert np.allclose(found.signals["y"][:, 1], -found.time, atol=1e-12)
