"""``echelon check`` and ``identify --check``: what a script or a first look wants to know of logs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import echelon as ec
from echelon.cli.terminal import print_identification
from support.command_line import run
from support.paths import EXAMPLES
from support.pendulum_logs import write_log
from support.report_data import identification

LOG = "log: {time: t, position: 'q{i}', output: 'tau{i}'}\npreparation: {still: 0}\n"


@pytest.fixture
def setup(tmp_path: Path) -> Path:
    """A set-up of a double pendulum, beside two logs."""
    path = tmp_path / "setup.yaml"
    path.write_text((EXAMPLES / "double_pendulum.yaml").read_text() + LOG)
    for k in range(2):
        write_log(tmp_path / f"run{k}.parquet", 3000, seed=k)
    return path


def flipped(log: Path) -> Path:
    """The log with the sign of its first output changed."""
    table = pq.read_table(log)
    values = -table["tau0"].to_numpy()
    pq.write_table(
        table.set_column(table.column_names.index("tau0"), "tau0", [values]), log
    )
    return log


def test_a_good_model_passes_the_gate(setup: Path) -> None:
    done = run(
        "identify",
        str(setup),
        str(setup.with_name("run0.parquet")),
        "--no-physical",
        "--check",
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "The model predicts every output well" in " ".join(done.stdout.split())


def test_the_gate_gives_its_reasons(setup: Path) -> None:
    log = flipped(setup.with_name("run0.parquet"))
    done = run("identify", str(setup), str(log), "--no-physical", "--check")
    assert done.returncode == 1
    assert done.stderr.startswith("echelon: do not use the model: on unseen data")
    assert run("identify", str(setup), str(log), "--no-physical").returncode == 0


def test_identify_and_predict_agree(setup: Path) -> None:
    """Scores of an unseen log are equal in both, and both leave out the rows that the ends of the log spoil."""
    fitted, unseen = (setup.with_name(f"run{k}.parquet") for k in range(2))
    result = ec.identify(
        ec.load_setup(setup).with_settings(physical=False), [fitted], [unseen]
    )
    ec.save_identification(result, setup.with_name("model.json"))
    model = ec.load_identified(setup.with_name("model.json"))
    found = ec.predict_log(model.plan, model.values, unseen)
    for one, other in zip(result.validations[-1].scores, found.scores, strict=True):
        assert one.whole == other.whole
        assert one.moving == other.moving
        assert one.raw == other.raw
    assert found.measured is not None
    np.testing.assert_array_equal(found.time, pq.read_table(unseen)["t"].to_numpy())
    inside = ~found.near_ends
    known = np.isfinite(found.predicted)
    np.testing.assert_array_equal(known, np.column_stack([inside, inside]))
    assert inside.sum() == found.scores[0].raw.rows
    raw = result.validations[-1].traces[1].raw
    assert raw is not None
    np.testing.assert_allclose(raw.time, found.time[inside], rtol=1e-12)
    np.testing.assert_array_equal(raw.measured, found.measured[inside, 1])
    np.testing.assert_allclose(raw.predicted, found.predicted[inside, 1], atol=1e-9)
    rest = (found.measured - found.predicted)[inside]
    assert np.sqrt(np.mean(rest**2, axis=0)) == pytest.approx(
        [s.raw.rms for s in found.scores], rel=1e-3
    )


def test_check_says_what_logs_show_and_lack(setup: Path) -> None:
    log = setup.with_name("run0.parquet")
    done = run("check", str(setup), str(log))
    assert done.returncode == 0, done.stderr
    assert "6 base parameters, 2 outputs; " in done.stdout
    assert "position: j1 ← 'q0', j2 ← 'q1'" in done.stdout
    assert "the data determine 6 of 6 base parameters" in done.stdout
    table = pq.read_table(log)
    still = table.set_column(
        table.column_names.index("q0"), "q0", [np.full(len(table), 0.3)]
    )
    pq.write_table(still, log)
    record = json.loads(run("check", str(setup), str(log), "--json").stdout)
    assert record["schema"] == "echelon.check/1"
    assert record["determined"] < record["base_parameters"] == 6
    assert any("j1" in text for text in record["missing"])


def test_a_terminal_lists_friction_of_robots_with_many_bodies(
    capsys: pytest.CaptureFixture[str],
) -> None:
    result = identification("tx40", samples=300)
    print_identification(result)
    lines = capsys.readouterr().out.splitlines()
    inertial = sum(
        result.base.mechanism.columns[k].body is not None
        for k in result.base.matrix.pivots
    )
    effects = [e.parameter for e in result.base.mechanism.effects]
    shown = [line for line in lines if line.split(" ")[0] in effects]
    assert len(shown) == result.base.rank - inertial > 0
    assert f"… and {inertial - 24} more of bodies" in "\n".join(lines)
