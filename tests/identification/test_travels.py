"""Logs that go far beyond the motion that a model was fitted to are named, and others are not."""

from __future__ import annotations

import json
from dataclasses import replace
from math import nan, pi
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.identification.rows.travels import Travel, beyond, joined
from support.command_line import run
from support.paths import EXAMPLES
from support.swinging_arm import ARM, Motion, swinging

NAMES = ("shoulder_joint", "elbow_joint")


def write(
    motion: Motion, path: Path, unit: float = 1.0, *names: str, torques: bool = False
) -> Path:
    """A log of positions, and of torques where they are asked for."""
    names = names or NAMES
    columns = {"t": motion["t"]}
    for k, name in enumerate(names):
        columns[f"q_{name}"] = motion["q"][:, k] / unit
    for k, name in enumerate(names if torques else ()):
        columns[f"tau_{name}"] = motion["tau"][:, k]
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="")
    return path


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a model of the arm, with the robot beside it."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(ARM)
    setup = ec.load_setup(folder / "arm.urdf").with_settings(physical=False)
    first, *others = (
        write(swinging(fast=fast), folder / f"{fast}.csv", torques=True)
        for fast in (1.0, 2.5, 1.3)
    )
    result = ec.identify(setup, [first], others)
    told = [some for some in result.findings if some.kind == "beyond"]
    # a log that is predicted well, too, is worth no warning
    assert [some.severity.value for some in told] == ["note", "note"]
    assert {some.where for some in told} == {str(others[0])}
    ec.save_identification(result, folder / "model.json")
    return folder / "model.json"


def told(model: Path, log: Path) -> list[str]:
    identified = ec.load_identified(model)
    found = ec.predict_log(identified.plan, identified.values, log)
    assert all(some.kind == "beyond" for some in found.findings)
    return [some.text for some in found.findings]


@pytest.mark.parametrize(
    ("motion", "options", "expected"),
    [
        (swinging(), {}, []),
        (swinging(fast=1.3), {}, []),
        (swinging(wide=0.1), {}, []),
        (swinging(fast=2.5), {}, ["{} moves up to", "accelerates up to"]),
        (swinging(wide=5.0), {}, ["{} moves up to", "goes from"]),
        # small angles in degrees that nobody says are in degrees
        (swinging(wide=0.1), {"unit": pi / 180}, ["{} moves up to", "goes from"]),
    ],
)
def test_motions_far_beyond_the_fitted_one_are_named(
    tmp_path: Path,
    model: Path,
    motion: Motion,
    options: dict[str, float],
    expected: list[str],
) -> None:
    found = told(model, write(motion, tmp_path / "log.csv", **options))
    assert len(found) == (len(NAMES) if expected else 0)
    for k, text in enumerate(found):
        assert all(some.format(NAMES[k]) in text for some in expected)
        assert "extrapolated" in text


def test_columns_that_were_exchanged_accelerate_otherwise(
    tmp_path: Path, model: Path
) -> None:
    log = write(swinging(), tmp_path / "log.csv", 1.0, *NAMES[::-1])
    (text,) = told(model, log)
    assert text.startswith("shoulder_joint accelerates up to ")


def test_the_command_says_it(tmp_path: Path, model: Path) -> None:
    log = write(swinging(fast=2.5), tmp_path / "log.csv")
    done = run("predict", str(model), str(log))
    assert done.returncode == 0
    speed, fitted = (np.abs(swinging(fast=f)["qd"][:, 0]).max() for f in (2.5, 1.0))
    text = f"moves up to {speed:.2g} rad/s (fitted: up to {fitted:.1g} rad/s)"
    assert done.stdout.startswith(f"warning: {log}: shoulder_joint {text}")
    record = json.loads(run("predict", str(model), str(log), "--json").stdout)
    assert [some["kind"] for some in record["findings"]] == ["beyond", "beyond"]


def test_a_file_without_travels_is_refused(tmp_path: Path, model: Path) -> None:
    document = json.loads(model.read_text())
    del document["travels"]
    (tmp_path / "model.json").write_text(json.dumps(document))
    with pytest.raises(ec.InputError, match="travels"):
        ec.load_identified(tmp_path / "model.json")


def test_a_plan_without_travels_says_that_nothing_is_known(
    tmp_path: Path, model: Path
) -> None:
    loaded = ec.load_identified(model)
    log = write(swinging(fast=2.5), tmp_path / "log.csv")
    found = ec.predict_log(replace(loaded.plan, travels=None), loaded.values, log)
    (finding,) = found.findings
    assert "are not named" in finding.text


def travel(name: str, low: float, high: float, rate: float = 1.0) -> Travel:
    return Travel(name, low, high, rate, rate)


def test_only_what_outputs_depend_on_counts() -> None:
    """Where a cart without friction is and how fast changes no force, and angles repeat."""
    cart = ec.base_parameters(ec.load(EXAMPLES / "cart_pole.yaml"))
    slide, pole = cart.mechanism.positions
    fitted = [travel(slide, 0.0, 0.1), travel(pole, -0.3, 0.3)]

    def found(*travels: Travel) -> list[str]:
        return list(beyond(cart, fitted, travels))

    assert not found(travel(slide, 5.0, 7.0), travel(pole, 6.1, 6.5))
    (text,) = found(travel(slide, 5.0, 7.0, 3.0))
    assert text.startswith(
        f"{slide} accelerates up to 3 m/s² (fitted: up to 1 m/s²), so"
    )
    (text,) = found(travel(pole, 2.0, 2.5))
    assert "goes from 2 to 2.5 rad (fitted: from -0.3 to 0.3 rad)" in text
    assert not list(beyond(cart, [travel(pole, -4.0, 4.0)], [travel(pole, 50, 90)]))


def test_springs_do_not_repeat_after_a_turn() -> None:
    text = (EXAMPLES / "cart_pole.yaml").read_text()
    text += "effects: [{type: spring, at: pole}]\n"
    base = ec.base_parameters(ec.load(text))
    pole = base.mechanism.positions[1]
    assert list(beyond(base, [travel(pole, -0.3, 0.3)], [travel(pole, 6.1, 6.5)]))


def test_noise_of_joints_at_rest_is_no_motion() -> None:
    base = ec.base_parameters(ec.load(EXAMPLES / "double_pendulum.yaml"))
    still = [travel("j1", 0.3, 0.30001, 1e-3), travel("j2", -1.0, 1.0)]
    noisy = [travel("j1", 0.2999, 0.3002, 1e-2), travel("j2", -1.0, 1.0)]
    assert not list(beyond(base, still, noisy))
    assert list(beyond(base, still, [travel("j1", 0.5, 0.50001, 1e-3)]))
    (text,) = beyond(base, still[1:], [travel("j1", 0.2, 0.5)])
    assert text.startswith("j1 moves up to 1 rad/s (fitted: up to 0 rad/s)")


def test_travels_of_several_logs_are_one() -> None:
    one, other = Travel("j", -1.0, 2.0, 3.0, nan), Travel("j", 0.0, 4.0, 1.0, 5.0)
    assert joined([one, other]) == (Travel("j", -1.0, 4.0, 3.0, 5.0),)
