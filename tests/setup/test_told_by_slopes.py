"""Velocities and rates that columns without names tell, and those that stay open."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
import yaml

import echelon as ec
from echelon.identification.judging import explained_rate
from echelon.identification.logs.columns.by_values import error_as_rates
from echelon.identification.setup.skeleton import Skeleton, skeleton
from support.command_line import run
from support.selection import one_in, slow_unless
from support.swinging_arm import ARM, swinging

Floats = npt.NDArray[np.float64]

MOTION = swinging()
GENERATOR = np.random.default_rng(5)


def rubbed(
    friction: tuple[float, float], coulomb: float = 0.0, noise: float = 0.02
) -> Floats:
    """Torques of the arm with viscous friction, N·m·s/rad, and dry friction, N·m."""
    torques = (
        MOTION["tau"]
        + np.array(friction) * MOTION["qd"]
        + coulomb * np.sign(MOTION["qd"])
    )
    return torques + noise * GENERATOR.normal(size=torques.shape)


def made(folder: Path, *columns: Floats, names: str = "") -> Skeleton:
    """The set-up for a log of some columns, with names or without."""
    (folder / "arm.urdf").write_text(ARM)
    log = pd.DataFrame(np.column_stack(columns), columns=names.split() or None)
    log.to_csv(folder / "log.csv", index=False, header=bool(names))
    return skeleton(folder / "arm.urdf", [folder / "log.csv"], folder, explained_rate)


def section(found: Skeleton) -> dict[str, object]:
    return dict(yaml.safe_load(found.text)["log"] or {})


@pytest.mark.parametrize("names", ["", "a b0 b1 c0 c1", "zz p0 p1 x0 x1"])
@pytest.mark.parametrize(
    "friction", [(300.0, 300.0), (300.0, 40.0), (57.3 * 3, 57.3 * 3)]
)
@pytest.mark.parametrize("unit", slow_unless([1e9], [1.0, 1e9]))
def test_torques_that_follow_velocities_are_torques(
    names: str, friction: tuple[float, float], unit: float, tmp_path: Path
) -> None:
    torques = rubbed(friction)
    assert np.corrcoef(torques[:, 0], MOTION["qd"][:, 0])[0, 1] > 0.95
    found = made(tmp_path, unit * (5 + MOTION["t"]), MOTION["q"], torques, names=names)
    assert "velocity" not in section(found)
    assert {"time", "position", "output"} <= section(found).keys()
    assert found.is_complete


@pytest.mark.parametrize("scale", [1.0, 180 / np.pi])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_velocities_beside_torques_that_follow_them_are_velocities(
    scale: float, noise: float, tmp_path: Path
) -> None:
    measured = scale * (
        MOTION["qd"] + noise * GENERATOR.normal(size=MOTION["qd"].shape)
    )
    found = made(
        tmp_path,
        MOTION["t"],
        MOTION["q"],
        rubbed((300.0, 300.0)),
        measured,
        names="zz p0 p1 x0 x1 y0 y1",
    )
    (velocity, output) = (str(section(found)[kind]) for kind in ("velocity", "output"))
    assert "y{" in velocity
    assert "x{" in output
    assert ("deg/s" in velocity) is (scale != 1.0)


@pytest.mark.parametrize("names", one_in(2, ["", "b0 b1 c0 c1"]))
def test_without_a_clock_no_rate_is_invented(names: str, tmp_path: Path) -> None:
    """Torques are none of the velocities that would tell it; one that masses and gravity tell is only proposed."""
    for torques in (rubbed((300.0, 40.0)), MOTION["tau"]):
        found = made(tmp_path, MOTION["q"], torques, names=names)
        assert section(found).keys() == {"position", "output"}
        assert any("state the rate" in question for question in found.undecided)
        assert not found.is_complete
    assert any("if the rate is 300 Hz" in question for question in found.undecided)


def test_columns_that_may_be_velocities_or_torques_stay_open_without_a_clock(
    tmp_path: Path,
) -> None:
    found = made(tmp_path, MOTION["q"], 1.7 * MOTION["qd"], names="b0 b1 c0 c1")
    assert "velocity" not in section(found)
    assert "rate" not in section(found)


def test_no_next_step_is_offered_while_outputs_are_open(tmp_path: Path) -> None:
    made(tmp_path, MOTION["t"], MOTION["q"], MOTION["qd"], names="time q1 q2 qd1 qd2")
    said = run(
        "setup",
        str(tmp_path / "arm.urdf"),
        str(tmp_path / "log.csv"),
        "-o",
        str(tmp_path / "setup.yaml"),
    )
    assert said.returncode == 0, said.stderr
    assert "open: no column recognised as the output" in said.stdout
    assert "next:" not in said.stdout


@pytest.mark.parametrize(
    ("factor", "is_rate"),
    [(1.0, True), (180 / np.pi, True), (1.4, False), (-1.0, False)],
)
def test_rates_have_the_slope_of_a_unit(factor: float, is_rate: bool) -> None:
    found = error_as_rates(MOTION["q"], factor * MOTION["qd"], MOTION["t"])
    assert np.isfinite(found) == is_rate
    assert np.isfinite(error_as_rates(MOTION["q"], abs(factor) * MOTION["qd"], None))


def test_slopes_do_not_mind_encoders_that_jump() -> None:
    jumping = MOTION["q"].copy()
    jumping[1000:, 0] -= 2 * np.pi
    jumping[1700:1702, 1] += 50.0
    assert error_as_rates(jumping, MOTION["qd"], MOTION["t"]) < 0.5


# -- logs that say nothing --------------------------------------------------------------------------------------------


NOTHING = {
    "nan": np.nan,
    "inf": np.inf,
    "constant": 0.7,
    "huge": 1e300,
    "tiny": 1e-300,
    "text": "AUTO",
    "empty": "",
}


@pytest.mark.parametrize("what", NOTHING)
@pytest.mark.parametrize("names", one_in(2, ["t q1 q2 tau1 tau2", "a b0 b1 c0 c1"]))
@pytest.mark.parametrize(
    "places",
    [
        (1, 2),
        (0, 1, 2, 3, 4),
        *(
            pytest.param(places, marks=pytest.mark.slow)
            for places in ((0,), (1,), (3, 4))
        ),
    ],
)
def test_columns_without_numbers_are_said_in_words(
    what: str, names: str, places: tuple[int, ...], tmp_path: Path
) -> None:
    """Neither the set-up nor the identification ends otherwise than with an answer or an error in words."""
    (tmp_path / "arm.urdf").write_text(ARM)
    log = pd.DataFrame(
        np.column_stack([MOTION["t"], MOTION["q"], MOTION["tau"]])[:200],
        columns=names.split(),
    )
    for place in places:
        log[log.columns[place]] = NOTHING[what]
    log.to_csv(tmp_path / "log.csv", index=False)
    for command in (
        lambda: skeleton(
            tmp_path / "arm.urdf", [tmp_path / "log.csv"], tmp_path, explained_rate
        ),
        lambda: ec.identify(tmp_path / "arm.urdf", tmp_path / "log.csv"),
    ):
        with suppress(ec.EchelonError):
            command()


@pytest.mark.parametrize("rows", [0, 1, 2, 3, 19])
@pytest.mark.parametrize("header", [True, False])
def test_logs_of_a_few_rows_are_said_in_words(
    rows: int, header: bool, tmp_path: Path
) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    log = pd.DataFrame(
        np.column_stack([MOTION["t"], MOTION["q"], MOTION["tau"]])[:rows]
    )
    log.columns = pd.Index(["t", "q1", "q2", "tau1", "tau2"])
    log.to_csv(tmp_path / "log.csv", index=False, header=header)
    with suppress(ec.InputError):
        assert not skeleton(
            tmp_path / "arm.urdf", [tmp_path / "log.csv"], tmp_path, explained_rate
        ).is_complete
    with pytest.raises(ec.InputError, match=r"log\.csv"):
        ec.identify(tmp_path / "arm.urdf", tmp_path / "log.csv")
