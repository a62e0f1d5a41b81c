"""Logs in which a joint that the robot has locked moves, or stands elsewhere, are refused with what to write."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.identification.setup.logs import with_logs
from echelon.identification.setup.skeleton import skeleton
from echelon.identification.surveying import first_look
from support.mounted_arm import log, urdf, write

GRAVITY = (0.0, 0.0, -9.81)
HEAD = "echelon: 1\nrobot: arm.urdf\neffects: none\n"
LOCKED = "locked: {j2: 0.7}\n"
LOG = 'log: {time: t, position: "q_{n}", output: "tau_{n}"}\n'
SETUPS = {
    "stated": HEAD + LOCKED + LOG,
    "guessed": HEAD + LOCKED,
    "experiment": HEAD + "experiments: [{name: held, locked: {j2: 0.7}}]\n" + LOG,
    "guessed experiment": HEAD + "experiments: [{name: held, locked: {j2: 0.7}}]\n",
}
MOVES = r"column 'q_2' \(position of 'j2'\).*locked at 0.7, but in the log it moves from -.* to .*leave it out of  locked"
ELSEWHERE = r"stands at 0.9\d*: write  locked: \{j2: 0.9\d*\}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("arm")
    (found / "arm.urdf").write_text(urdf())
    write(log(GRAVITY, 3, held={1: 0.7}), found / "held.csv")
    write(log(GRAVITY, 3, held={1: 0.9}), found / "held_elsewhere.csv")
    write(log(GRAVITY, 4), found / "held_free.csv")
    for name, text in SETUPS.items():
        (found / f"{name}.yaml").write_text(text)
    return found


def look(setup: Path, path: Path) -> tuple[str, ...]:
    """Columns of the positions that are used."""
    known, paths, _ = with_logs(ec.load_setup(setup), [path], ())
    first_look(known, paths)
    return tuple(c.column for c in known.columns[0].positions.values())


@pytest.mark.parametrize("name", SETUPS)
def test_a_locked_joint_that_stands_elsewhere_or_moves(folder: Path, name: str) -> None:
    setup = folder / f"{name}.yaml"
    assert look(setup, folder / "held.csv") == ("q_1", "q_3")
    with pytest.raises(ec.InputError, match=MOVES):
        look(setup, folder / "held_free.csv")
    with pytest.raises(ec.InputError, match=ELSEWHERE):
        look(setup, folder / "held_elsewhere.csv")


def test_what_rests_while_a_model_is_fitted_rests_where_it_predicts(
    folder: Path, tmp_path: Path
) -> None:
    (folder / "free.yaml").write_text(HEAD)
    ec.save_identification(
        ec.identify(folder / "free.yaml", [folder / "held.csv"]), tmp_path / "m.json"
    )
    model = ec.load_identified(tmp_path / "m.json")
    found = ec.predict_log(model.plan, model.values, folder / "held.csv")
    assert min(score.r2 for score in found.scores) > 0.99
    for wrong, message in (("free", "moves from"), ("elsewhere", ELSEWHERE)):
        with pytest.raises(ec.InputError, match=message):
            ec.predict_log(model.plan, model.values, folder / f"held_{wrong}.csv")


def test_a_written_set_up_names_the_column_of_a_joint_at_rest(folder: Path) -> None:
    found = skeleton(folder / "arm.urdf", [folder / "held.csv"], folder)
    assert found.is_complete
    assert "position: 'q_{n}'" in found.text
    assert "output: 'tau_{n}'" in found.text
    (folder / "written.yaml").write_text(found.text)
    assert look(folder / "written.yaml", folder / "held.csv") == ("q_1", "q_3")
    with pytest.raises(ec.InputError, match=ELSEWHERE):
        look(folder / "written.yaml", folder / "held_elsewhere.csv")


def test_positions_agree_to_what_the_log_resolves(folder: Path) -> None:
    """In whole degrees 0.7 rad are 40: 2 mrad less."""
    columns = log(GRAVITY, 3, held={1: 0.7})
    for name in ("q_1", "q_2", "q_3"):
        columns[name] = np.round(np.degrees(columns[name]) + 0.1)
    write(columns, folder / "degrees.csv")
    text = SETUPS["stated"].replace('"q_{n}"', 'all: {column: "q_{n}", unit: deg}')
    (folder / "degrees.yaml").write_text(text.replace("position: all: ", "position: {all: ").replace("deg}", "deg}}"))  # fmt: skip
    assert look(folder / "degrees.yaml", folder / "degrees.csv") == ("q_1", "q_3")


PARTLY = (
    "log: {time: t, position: {j1: q_1, j3: q_3}, output: {j1: tau_1, j3: tau_3}}\n"
)
LEFT_OUT = {
    "stated": HEAD + LOCKED + PARTLY,
    "experiment": HEAD
    + "experiments: [{name: held, locked: {j2: 0.7}}, {name: other}]\n"
    + PARTLY.replace("log: {", "log: {experiment: held, "),
}


def without_position(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The log with the velocity of the second joint in the place of its position."""
    rate = np.gradient(columns["q_2"], columns["t"])
    return {n: v for n, v in columns.items() if n != "q_2"} | {"dq_2": rate}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_columns_that_nobody_stated_are_told_by_their_names(
    folder: Path, tmp_path: Path, name: str
) -> None:
    (tmp_path / "arm.urdf").write_text(urdf())
    (tmp_path / "x.yaml").write_text(LEFT_OUT[name])
    write(without_position(log(GRAVITY, 4)), tmp_path / "held_moves.csv")
    write(without_position(log(GRAVITY, 3, held={1: 0.7})), tmp_path / "held_rests.csv")

    def told(path: Path) -> list[str]:
        setup, paths, _ = with_logs(ec.load_setup(tmp_path / "x.yaml"), [path], ())
        findings = first_look(setup, paths).survey.findings
        return [str(some) for some in findings if some.kind == "locked"]

    assert not told(folder / "held.csv")
    assert not told(tmp_path / "held_rests.csv")
    (found,) = told(folder / "held_elsewhere.csv")
    assert "column 'q_2' (position of 'j2' by its name, which is not under" in found
    assert "locked at 0.7, but in the log it stands at 0.9" in found
    (found,) = told(folder / "held_free.csv")
    assert "in the log it moves from -" in found
    (found,) = told(tmp_path / "held_moves.csv")
    assert "column 'dq_2' (velocity of 'j2' by its name" in found
    assert "in the log it moves at up to" in found


def test_a_stated_velocity_tells_that_a_locked_joint_moves(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(urdf())
    text = PARTLY.replace("time: t", "time: t, velocity: {j1: v1, j2: dq_2, j3: v3}")
    (tmp_path / "x.yaml").write_text(HEAD + LOCKED + text)
    rng = np.random.default_rng(1)
    for name, held in (("moves", {}), ("rests", {1: 0.7})):
        columns = log(GRAVITY, 3, held=held)
        rates = {f"v{k}": np.gradient(columns[f"q_{k}"], columns["t"]) for k in (1, 3)}
        found = without_position(columns) | rates
        # a sensor of velocity whose noise is a few per cent of a usual speed
        found["dq_2"] += 0.05 * rng.normal(size=len(found["t"]))
        write(found, tmp_path / f"{name}.csv")
    assert look(tmp_path / "x.yaml", tmp_path / "rests.csv") == ("q_1", "q_3")
    with pytest.raises(
        ec.InputError, match=r"'dq_2' \(velocity of 'j2'\).*moves at up to"
    ):
        look(tmp_path / "x.yaml", tmp_path / "moves.csv")


def test_a_driven_motion_moves_a_locked_joint(folder: Path, tmp_path: Path) -> None:
    columns = {n.replace("q_", "q_j"): v for n, v in log(GRAVITY, 4).items() if "q" in n or n == "t"}  # fmt: skip
    write(columns, tmp_path / "moves.csv")
    write(columns | {"q_j2": 0 * columns["t"] + 0.7}, tmp_path / "rests.csv")
    held = ec.load(folder / "arm.urdf", locked={"j2": 0.7})
    assert ec.sampled_rank(held, tmp_path / "rests.csv").rank > 0
    with pytest.raises(ec.InputError, match=r"'q_j2'.*'j2' locked at 0.7.*moves from"):
        ec.sampled_rank(held, tmp_path / "moves.csv")
    text = HEAD + "experiments: [{name: held, locked: {j2: 0.7}, motion: FILE}]\n"
    for name in ("moves", "rests"):
        (tmp_path / "arm.urdf").write_text(urdf())
        (tmp_path / "x.yaml").write_text(text.replace("FILE", f"{name}.csv"))
        if name == "rests":
            assert ec.sampled_rank(tmp_path / "x.yaml").rank > 0
            continue
        with pytest.raises(ec.InputError, match=r"'j2' locked at 0\.7"):
            ec.sampled_rank(tmp_path / "x.yaml")
