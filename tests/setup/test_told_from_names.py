"""Columns are told by the usual names of recorders; torques, silent encoders and degrees are asked about."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
import scipy.io
import yaml

import echelon as ec
from echelon.identification.setup.logs import with_logs
from echelon.identification.setup.skeleton import Skeleton, skeleton
from support.selection import one_in
from support.swinging_arm import ARM, swinging

Floats = npt.NDArray[np.float64]

MOTION = swinging()
TIME, Q, QD, TAU = (MOTION[name] for name in ("t", "q", "qd", "tau"))
ASKED = Q - 0.01 * QD
STILL = np.zeros_like(Q)
JOINTS = ("shoulder", "elbow")
WARM = 30 + np.random.default_rng(1).normal(size=Q.shape)


def made(folder: Path, content: Mapping[str, Any], *, matlab: bool = False) -> Skeleton:
    """The set-up of a log; in names of columns {n} is a number and {j} the name of a joint."""
    (folder / "arm.urdf").write_text(ARM)
    log = folder / ("log.mat" if matlab else "log.csv")
    if matlab:
        scipy.io.savemat(log, dict(content))
    else:
        pd.DataFrame(columns(content)).to_csv(log, index=False)
    return skeleton(folder / "arm.urdf", [log], folder)


def columns(content: Mapping[str, Floats]) -> dict[str, Floats]:
    found = {}
    for name, values in content.items():
        several = (
            dict(zip(range(2), values.T, strict=True))
            if values.ndim == 2
            else {0: values}
        )
        found |= {
            name.format(n=k + 1, j=JOINTS[k]): some for k, some in several.items()
        }
    return found


def said(found: Skeleton, kind: str) -> str:
    """Entry of a set-up for a kind of quantity."""
    return str(yaml.safe_load(found.text)["log"].get(kind, ""))


# -- torques and servos -----------------------------------------------------------------------------------------------


OUTPUTS: dict[str, dict[str, Any]] = {
    "tau_m": {"q": Q, "tau_m": TAU, "q_des": ASKED},
    "q_m": {"q_m": Q, "dq_m": QD, "tau_m": TAU, "tau_d": TAU + 0.1, "q_d": ASKED},
    "transposed": {"q": Q.T, "dq": QD.T, "torque": TAU.T, "q_cmd": ASKED.T},
    "struct": {"log": {"t": TIME, "q": Q, "dq": QD, "tau": TAU, "q_ref": ASKED}},
    "runs": {
        "train": {
            "t": TIME[:2000],
            "q": Q[:2000],
            "tau": TAU[:2000],
            "q_des": ASKED[:2000],
        },
        "test": {
            "t": TIME[2000:],
            "q": Q[2000:],
            "tau": TAU[2000:],
            "q_des": ASKED[2000:],
        },
    },
    "currents": {"q": Q, "tau_cmd": TAU, "I_meas": TAU / 0.5, "q_des": ASKED},
    "warm": {"q": Q, "T": TAU, "temp": WARM, "q_des": ASKED},
}


@pytest.mark.parametrize("case", OUTPUTS)
def test_torques_of_matlab_are_outputs(case: str, tmp_path: Path) -> None:
    content = (
        OUTPUTS[case] if case in ("struct", "runs") else {"t": TIME, **OUTPUTS[case]}
    )
    found = made(tmp_path, content, matlab=True)
    output, asked = said(found, "output"), said(found, "reference")
    assert any(word in output for word in ("tau", "torque", "I_meas", "T["))
    assert any(word in asked for word in ("des", "cmd", "ref", "q_d"))
    assert not said(found, "input")
    assert found.is_complete


OPEN: dict[str, dict[str, Any]] = {
    "tau_cmd and tau_filt": {"tau_cmd": TAU, "tau_filt": TAU + 0.1 * WARM},
    "u and w": {"u": TAU, "w": WARM},
    "one column": {"tau": TAU[:, :1]},
    "three columns": {"tau": np.column_stack([TAU, TAU[:, 0]])},
    "a row less": {"tau": TAU[1:]},
}


@pytest.mark.parametrize("case", OPEN)
def test_no_servos_are_fitted_where_something_may_be_an_output(
    case: str, tmp_path: Path
) -> None:
    found = made(
        tmp_path,
        {"t": TIME, "q": Q, "dq": QD, "q_des": ASKED, **OPEN[case]},
        matlab=True,
    )
    assert not found.is_complete
    assert not said(found, "input")
    assert any(name in " ".join(found.undecided) for name in OPEN[case])


@pytest.mark.parametrize(
    "more", [{}, {"temp": WARM}, {"status": STILL}, {"dq_des": QD, "ddq_des": QD}]
)
def test_commands_beside_nothing_that_may_be_an_output_are_those_of_servos(
    more: dict[str, Floats], tmp_path: Path
) -> None:
    found = made(
        tmp_path, {"t": TIME, "q": Q, "dq": QD, "q_des": ASKED, **more}, matlab=True
    )
    assert "q_des" in said(found, "input")
    with pytest.raises(
        ec.InputError, match="servos can be fitted: name the commands under input"
    ):
        ec.identify(tmp_path / "arm.urdf", tmp_path / "log.mat")


# -- silent sensors ---------------------------------------------------------------------------------------------------


SILENT: dict[str, tuple[dict[str, Floats], str]] = {
    "motor and link": (
        {"motor_pos_{n}": Q, "link_pos_{n}": STILL, "tau_{n}": TAU},
        "motor_pos",
    ),
    "motor and joint": (
        {"motor_position_{n}": Q, "joint_position_{n}": STILL, "torque_{n}": TAU},
        "motor_position",
    ),
    "names": ({"q_mot_{j}": Q, "q_{j}": STILL, "tau_{j}": TAU}, "q_mot"),
    "names first": (
        {"{j}_pos": STILL, "{j}_pos_motor": Q, "{j}_tau": TAU},
        "pos_motor",
    ),
    "two numbers": (
        {"encoder2_{n}": STILL, "encoder1_{n}": Q, "tau_{n}": TAU},
        "encoder1",
    ),
    "one of them": (
        {"motor_pos_{n}": Q, "link_pos_{n}": Q * [1, 0], "tau_{n}": TAU},
        "motor_pos",
    ),
    "no numbers": (
        {"motor_pos_{n}": Q, "link_pos_{n}": np.full_like(Q, np.nan), "tau_{n}": TAU},
        "motor_pos",
    ),
    "twice": ({"pos_link_{n}": STILL, "pos_{n}": Q, "tau_{n}": TAU}, "pos_"),
}


@pytest.mark.parametrize("case", SILENT)
def test_encoders_that_never_change_are_none(case: str, tmp_path: Path) -> None:
    content, position = SILENT[case]
    found = made(tmp_path, {"t": TIME, **content})
    assert position in said(found, "position")
    assert "link" not in said(found, "position")
    assert "\nlocked" not in found.text
    assert found.is_complete
    motors = any("names of motors" in text for text in found.report)
    assert motors == ("mot" in position)


@pytest.mark.parametrize("output", ["current", "torque"])
def test_torques_that_are_all_zero_are_none(output: str) -> None:
    log = pd.DataFrame(
        columns({"t": TIME, "q_{n}": Q, "tau_{n}": STILL, f"{output}_{{n}}": TAU})
    )
    setup, _, _ = with_logs(ARM, log)
    assert [channel.column for channel in setup.columns[0].outputs.values()] == [
        f"{output}_1",
        f"{output}_2",
    ]


def test_a_joint_whose_samples_are_all_alike_rests_or_has_no_sensor(
    tmp_path: Path,
) -> None:
    found = made(tmp_path, {"t": TIME, "q{n}": Q * [1, 0], "tau{n}": TAU})
    assert "\nlocked: {elbow_joint: 0.0}" in found.text
    assert any(
        "all samples of elbow_joint are equal: does the joint rest, or does it lack a sensor?"
        in t
        for t in found.report
    )


# -- units in names ---------------------------------------------------------------------------------------------------


DEGREES = [
    ("q{n}_deg", "dq{n}_deg_s", "tau{n}"),
    ("joint {n} [deg]", "joint {n} [deg/s]", "joint {n} [Nm]"),
    ("joint{n} [deg]", "joint{n}_vel [deg/s]", "joint{n}_tau [Nm]"),
    ("pos_deg_{n}", "vel_deg_s_{n}", "torque_{n}"),
    ("q{n}_deg", "qd{n}_dps", "tau{n}_Nm"),
    ("q_deg_{n}", "qd_degps_{n}", "tau_Nm_{n}"),
    ("q_deg_{n}", "dq_deg_{n}", "tau_m_{n}"),
    ("Theta{n}(deg)", "Theta{n}(deg/s)", "Theta{n}(Nm)"),
    ("posDeg{n}", "velDegS{n}", "tau{n}"),
    ("deg{n}", "degs{n}", "tau{n}"),
    ("qdeg{n}", "dqdeg{n}", "tau{n}"),
    ("{j}_deg", "{j}_deg_s", "{j}_Nm"),
    ("q{n} (°)", "dq{n} (°/s)", "tau{n} (N·m)"),
    ("xx{n} deg", "yy{n} deg/s", "zz{n} Nm"),
    ("foo_deg_{n}", "bar_degps_{n}", "baz_{n}"),
    ("foo{n}_deg", "bar{n}_deg_s", "baz{n}_nm"),
]


@pytest.mark.parametrize(("position", "velocity", "output"), one_in(3, DEGREES))
def test_degrees_in_names_count_whatever_the_names_are(
    position: str, velocity: str, output: str, tmp_path: Path
) -> None:
    """Angles are so small that their size says nothing of their unit."""
    degrees = 0.1 * 180 / np.pi
    found = made(
        tmp_path,
        {"t": TIME, position: degrees * Q, velocity: degrees * QD, output: TAU},
    )
    assert found.is_complete
    assert f"'unit': '{'°' if '°' in position else 'deg'}'" in said(found, "position")
    assert f"'unit': '{'°/s' if '°' in position else 'deg/s'}'" in said(
        found, "velocity"
    )
    assert not said(found, "reference")


# -- columns that nobody needs ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "more",
    one_in(
        2,
        [
            {"dq{n}": -QD},
            {"q{n}_des": 1e300 * QD},
            {"dq{n}": QD[:, ::-1]},
            {"q{n}_des": np.full_like(QD, np.nan)},
            {"dq{n}": STILL},
            {"ddq{n}": np.full_like(QD, np.nan)},
            {"dq{n}": np.full_like(QD, np.nan)},
        ],
    ),
)
def test_faults_of_columns_that_are_not_used_are_said_and_do_not_spoil_the_verdict(
    more: dict[str, Floats],
) -> None:
    result = ec.identify(
        ARM, pd.DataFrame(columns({"t": TIME, "q{n}": Q, **more, "tau{n}": TAU}))
    )
    assert result.verdict.startswith("The model predicts every output well")
    assert not result.reasons
    words = ("derivative", "exchanged", "hold no numbers", "is 0 in all")
    assert any(word in finding.text for finding in result.findings for word in words)
