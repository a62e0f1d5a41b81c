"""Several experiments with one robot: base parameters of stacked rows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.robot.experiment import experiment_of
from support.paths import EXAMPLES
from support.stacked_rows import Observed, agrees, random_urdf

PANDA = EXAMPLES / "panda.yaml"


@pytest.fixture(scope="module")
def panda() -> ec.Mechanism:
    return ec.load(PANDA)


def test_a_wall_shows_what_a_table_does_not(panda: ec.Mechanism) -> None:
    table = ec.Experiment(panda, "table")
    wall = ec.Experiment(panda, "wall", gravity=(9.81, 0, 0))
    both = ec.base_parameters([table, wall])
    won = set(both.pivots) - set(ec.base_parameters(table).pivots)
    assert (both.rank, won) == (45, {"MX1", "MY1"})
    assert not both.certificate.unchecked


def test_one_experiment_is_the_robot_itself(panda: ec.Mechanism) -> None:
    alone = ec.base_parameters(ec.Experiment(panda, "table"))
    assert str(alone) == str(ec.base_parameters(panda))


def test_the_same_experiment_twice_adds_nothing(panda: ec.Mechanism) -> None:
    twice = ec.base_parameters([ec.Experiment(panda), ec.Experiment(panda)])
    assert twice.expressions == ec.base_parameters(panda).expressions


def test_a_load_is_told_from_the_link_that_carries_it(panda: ec.Mechanism) -> None:
    loaded = ec.Experiment(panda, "loaded", payloads={"tool": "j7"})
    alone, both = (
        ec.base_parameters(loaded),
        ec.base_parameters([ec.Experiment(panda), loaded]),
    )
    assert (alone.rank, both.rank) == (43, 53)
    assert {f"{kind}_tool" for kind in ("M", "MX", "XX")} <= set(both.parameters)


def test_a_plan_is_the_smallest_choice_and_says_how_it_knows(
    panda: ec.Mechanism,
) -> None:
    table, wall = (
        ec.Experiment(panda, "table"),
        ec.Experiment(panda, "wall", gravity=(9.81, 0, 0)),
    )
    loaded = ec.Experiment(panda, "loaded", payloads={"tool": "j7"})
    found = ec.plan([table, wall, loaded])
    assert found.added == (("table", 43), ("wall", 45), ("loaded", 55))
    assert (found.smallest, found.at_least, found.proven_smallest) == (
        ("wall", "loaded"),
        2,
        True,
    )


def test_a_plan_without_budget_bounds_what_it_did_not_try(panda: ec.Mechanism) -> None:
    names = [f"j{k}" for k in range(1, 8)]
    locked = [ec.Experiment(panda, f"but_{n}", locked={n: 0.4}) for n in names]
    found = ec.plan(locked, size=0, budget=0)
    assert 1 <= found.at_least <= len(found.smallest)
    assert found.proven_smallest == (found.at_least == len(found.smallest))


def random_experiments(seed: int) -> tuple[list[ec.Experiment], list[np.ndarray]]:
    """Experiments with a random arm, and their rows by Pinocchio."""
    import pinocchio as pin

    rng = np.random.default_rng(seed)
    joints = int(rng.integers(2, 6))
    text = random_urdf(rng, joints)
    names = [f"j{k}" for k in range(1, joints + 1)]
    model = pin.buildModelFromXML(text)
    robot = ec.load(text, snap_tolerance=0)
    observed = Observed(model, [body.joint.name for body in robot.bodies])
    experiments, rows = [], []
    for k in range(int(rng.integers(2, 4))):
        gravity: Any = (
            9.81 * rng.permutation([1.0, 0, 0])
            if rng.random() < 0.5
            else rng.normal(size=3)
        )
        held = rng.choice(names, size=int(rng.integers(0, joints)), replace=False)
        locked = {str(name): float(np.round(rng.uniform(-1, 1), 2)) for name in held}
        experiments.append(
            ec.Experiment(
                robot, f"e{k}", gravity=tuple(map(float, gravity)), locked=locked
            )
        )
        rows.append(observed.arm(rng, gravity, locked))
    return experiments, rows


def check_random(seed: int) -> None:
    experiments, rows = random_experiments(seed)
    base = ec.base_parameters(experiments, budget=0)
    assert agrees(base, np.vstack(rows))
    added = ec.plan(experiments).added
    for k, (_, rank) in enumerate(added):
        assert rank == ec.base_structure(ec.joined(experiments[: k + 1])).rank


@pytest.mark.parametrize("seed", range(6))
def test_random_arms_agree_with_stacked_rows_of_pinocchio(seed: int) -> None:
    check_random(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6, 40))
def test_more_random_arms_agree_with_stacked_rows_of_pinocchio(seed: int) -> None:
    check_random(seed)


def test_an_experiment_is_taken_out_with_its_own_names_and_all_parameters(
    panda: ec.Mechanism,
) -> None:
    loaded = ec.Experiment(panda, "loaded", payloads={"tool": "j7"})
    whole = ec.joined([ec.Experiment(panda, "empty"), loaded])
    for name in ("empty", "loaded"):
        own = experiment_of(whole, name)
        assert own.positions == panda.positions
        assert set(own.parameters) == set(whole.parameters)


def test_friction_of_a_locked_joint_is_seen_in_the_other_experiment() -> None:
    text = (
        "echelon: 1\ngravity: [0, 0, -9.81]\neffects: [{type: viscous, at: all}]\n"
        "experiments: [{name: free}, {name: held, locked: {j2: 0.3}}]\n"
        "modified_dh: [{joint: revolute}, {joint: revolute, alpha: pi/2, a: '0.3'}]\n"
    )
    base = ec.base_parameters(ec.load(text))
    assert {"Fv1", "Fv2"} <= set(base.pivots)
    assert ec.sensor_report(ec.load(text)).smallest == ("free",)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"locked": {"j9": 0}}, "no coordinate 'j9'"),
        ({"sensors": ["nose"]}, "no sensor 'nose'"),
        ({"payloads": {"tool": "hand"}}, "no body 'hand'"),
        ({"contacts": ["foot"]}, "no contact 'foot'"),
        ({"gravity": (0, 0, 0)}, "not all zero"),
    ],
)
def test_what_the_robot_does_not_have_is_named(
    panda: ec.Mechanism, wrong: dict[str, Any], said: str
) -> None:
    with pytest.raises(ec.InputError, match=said):
        ec.base_parameters([ec.Experiment(panda), ec.Experiment(panda, "odd", **wrong)])


def test_robots_that_disagree_are_refused(panda: ec.Mechanism) -> None:
    longer = PANDA.read_text().replace("a4: 0.0825", "a4: 0.09")
    with pytest.raises(ec.InputError, match="disagree about symbol 'a4'"):
        ec.joined([ec.Experiment(panda), ec.Experiment(ec.load(longer))])


def test_a_saved_set_of_experiments_is_verified_and_read_again(tmp_path: Any) -> None:
    base = ec.base_parameters(ec.load(EXAMPLES / "experiments/panda_mounted.yaml"))
    ec.save_base(base, tmp_path / "set.json")
    assert ec.verify(tmp_path / "set.json").rank == 45
    again = ec.load_base(tmp_path / "set.json")
    assert again.mechanism.experiments == ("table", "wall")
    assert again.expressions == base.expressions


def test_motions_are_those_of_one_experiment(tmp_path: Any) -> None:
    with pytest.raises(ec.InputError, match="this is about one of them"):
        ec.exciting_trajectory(EXAMPLES / "experiments/panda_mounted.yaml")
    file = tmp_path / "touching.yaml"
    file.write_text(PANDA.read_text() + "contacts: [{body: j7}]\n")
    with pytest.raises(ec.InputError, match="leave contacts out"):
        ec.exciting_trajectory(file)


def test_one_of_several_is_read_alone_and_excited(tmp_path: Any) -> None:
    """A motion for the pendulum with its first joint held moves the other, and shows what that experiment shows."""
    text = (EXAMPLES / "double_pendulum.yaml").read_text()
    file = tmp_path / "two.yaml"
    entries = "experiments: [{name: free}, {name: held, locked: {j1: 0.5}}]\n"
    file.write_text(text + entries)
    held = ec.load(file, experiment="held")
    assert (held.experiments, held.positions) == ((), ("j2",))
    found = ec.exciting_trajectory(
        ec.load_setup(file, experiment="held"),
        duration=4,
        starts=1,
        limits={"velocity": 3, "position": [-2, 2]},
    )
    assert found.safe
    assert found.trajectory.coordinates == ("j2",)
    assert found.base.rank == ec.base_parameters(held).rank
    with pytest.raises(ec.InputError, match=r"no experiment 'hold'.*'held'"):
        ec.load(file, experiment="hold")
    setup = replace(ec.load_setup(file, experiment="free"), mechanism=ec.load(file))
    with pytest.raises(ec.InputError, match="this is about one of them"):
        ec.exciting_trajectory(setup)
    touching = ec.load(text + "contacts: [{body: j2}]\n")
    with pytest.raises(ec.InputError, match="no contact slips cannot be planned"):
        ec.exciting_trajectory(replace(setup, mechanism=touching))


def test_sensors_that_locks_leave_out_are_refused(panda: ec.Mechanism) -> None:
    with pytest.raises(ec.InputError, match="'j1' is locked"):
        ec.base_parameters(ec.Experiment(panda, sensors=["j1", "j2"], locked={"j1": 0}))
    every = dict.fromkeys(panda.positions, 0.0)
    with pytest.raises(ec.InputError, match="measures nothing"):
        ec.base_parameters(ec.Experiment(panda, locked=every))


def test_names_that_occur_twice_are_refused(panda: ec.Mechanism) -> None:
    with pytest.raises(ec.InputError, match="two experiments have the name 'e2'"):
        ec.joined([ec.Experiment(panda, "e2"), ec.Experiment(panda)])
    with pytest.raises(ec.InputError, match="has the name of a body"):
        ec.base_parameters(ec.Experiment(panda, payloads={"j3": "j2"}))


def test_one_experiment_does_not_claim_the_proof_of_all() -> None:
    base = ec.base_parameters(ec.load(EXAMPLES / "experiments/panda_mounted.yaml"))
    table = base.experiment("table")
    assert "belongs to all experiments" in str(table.certificate)
