"""Identification from measured logs: the set-ups of examples/ on real robots, judged on data that the fits did not see.

python benchmarks/real_logs.py             identify, print, and write benchmarks/results/real_logs.md

The logs are not part of the project.  They are looked for in the folder that ECHELON_DATA names, by default
../shared/data beside the project; without them nothing is done.
"""

from __future__ import annotations

import csv
import os
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import echelon as ec
from log_tables import (
    column,
    figures,
    interval,
    outputs_table,
    overall,
    summary,
    summary_tables,
    values,
)
from tabular import table

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "examples"
DATA = Path(os.environ.get("ECHELON_DATA", ROOT.parent / "shared" / "data"))
OUTPUT = ROOT / "benchmarks" / "results" / "real_logs.md"


class AbsentError(Exception):
    """A measured log is not there."""


@dataclass(frozen=True)
class Section:
    """What one robot's logs gave.

    Attributes
    ----------
    title : str
    summary : list of rows
        For the table that README and docs quote; see :data:`SUMMARY`.
    blocks : list of str
        Markdown: sentences and tables.
    """

    title: str
    summary: list[list[str]]
    blocks: list[str]


def log(name: str) -> Path:
    """A log of the data folder."""
    path = DATA / name
    if not path.is_file():
        raise AbsentError(f"the measured log is not there: {path}")
    return path


def changed(setup: ec.Setup, **settings: Any) -> ec.Setup:
    """A set-up with other settings."""
    return setup.with_settings(**settings)


# -- robots ------------------------------------------------------------------------------------------------------------


def emps() -> Section:
    """One drive, one slide."""
    setup = ec.load_setup(EXAMPLES / "logs" / "emps.yaml")
    result = ec.identify(
        setup, [log("emps/data_emps.parquet")], [log("emps/data_emps_pulses.parquet")]
    )
    published = {"M1": 95.1089, "Fv1": 203.5034, "Fc1": 20.3935, "Fo1": -3.1648}
    found, std = (
        values(result),
        dict(zip(result.estimate.parameters, result.estimate.std, strict=True)),
    )
    units = dict(zip(result.estimate.parameters, result.estimate.units, strict=True))
    rows = [
        [
            f"{n} ({units[n]})",
            f"{found[n]:.5g}",
            f"{std[n]:.2g}",
            v,
            f"{100 * (found[n] / v - 1):+.2f} %",
        ]
        for n, v in published.items()
    ]
    beside = "rms published: 1.94 N fitted, 2.51 N pulses"
    line = summary(
        "EMPS",
        "another run, with disturbing pulses",
        result.validations[1].scores,
        beside,
    )
    names = table(
        ["parameter", "value", "standard deviation", "published", "difference"], rows
    )
    return Section("EMPS", [line], [names, outputs_table(result.validations)])


def tx40() -> Section:
    """Six joints with a coupled wrist, measured at the motors."""
    path = log("staubli_tx40/tx40_5kHz.parquet")
    setup = ec.load_setup(
        EXAMPLES / "tx40.yaml", prior=log("staubli_tx40/model/tx40_mdh_modified.urdf")
    )
    whole = ec.identify(changed(setup, holdout=0.0, physical=False), [path])
    published = published_tx40()
    found, ours = (
        values(whole),
        dict(zip(whole.estimate.parameters, whole.estimate.std, strict=True)),
    )
    apart = {
        name: abs(found[name] - value) / np.hypot(std, ours[name])
        for name, (value, std) in published.items()
    }
    worst = max(apart, key=lambda name: apart[name])
    held = ec.identify(changed(setup, physical=False), [path]).validations
    near, median = (
        sum(x <= 2.5 for x in apart.values()),
        np.median(list(apart.values())),
    )
    rms = overall([s.moving for s in whole.validations[0].scores])
    text = (
        f"On the whole log: {near} of {len(apart)} published values within 2.5 standard deviations of the difference "
        f"(largest {apart[worst]:.2g}, {worst}; median {median:.2g}), overall rms {rms:.4g} N·m of the rows that move "
        "(published 1.07).  Below, the last 30 % are held out, where the robot rests more than half of the time.  The "
        "prior is the URDF, whose inertias are nominal and which knows no rotors."
    )
    moving = [s.moving for s in held[1].scores]
    beside = f"overall {overall(moving):.3g} N·m"
    line = summary(
        "TX40, rows that move", "last 30 % of the log", moving, beside, unit="N·m"
    )
    return Section("Stäubli TX40", [line], [text, outputs_table(held)])


def published_tx40() -> dict[str, tuple[float, float]]:
    """Least-squares values and standard deviations by the names of the representatives."""
    kinds = {"fv": "Fv", "fs": "Fc", "off": "Fo", "Ia": "Ia"}
    found = {}
    for expression, value, percent, *_ in csv.reader(
        log("staubli_tx40/reference/TX40_bp_5.csv").open()
    ):
        first = re.split(r" [+-] ", expression)[0].strip()
        kind, axes, number = re.fullmatch(
            r"(I|m|fv|fs|off|Ia)([xyz]*)(m?\d)", first
        ).groups()
        stem = (
            axes.upper()
            if kind == "I"
            else f"M{axes.upper()}"
            if kind == "m"
            else kinds[kind]
        )
        if number.startswith("m"):  # what motor 6 does to joint 5
            stem = kind
        found[stem + number] = (float(value), abs(float(value)) * float(percent) / 100)
    return found


SLOW_RUN = "A0_20220812_061157-PM"
SLOW = f"double_pendulum/{SLOW_RUN}.parquet"
FAST = ("A0_20220812_061705-PM", "A0_20220815_traj_11")
RUNS = (
    *FAST,
    *(f"A0_20220815_traj_{k:02}" for k in (0, 1, 2, 3, 4, 5, 12, 13)),
    "A0_20220812_055032-PM",
)


def pendulum() -> Section:
    """Two quasi-direct drives, with the published models beside on the same rows."""
    setup = ec.load_setup(EXAMPLES / "logs" / "double_pendulum.yaml")
    others = [log(f"double_pendulum/{name}.parquet") for name in RUNS]
    part, whole = changed(setup, holdout=1 / 3), setup
    held = ec.identify(part, [log(SLOW)])
    ours = ec.identify(whole, [log(SLOW)], others).validations[1:]
    models = {name: published_pendulum(setup, name) for name in ("1.0", "2.0")}
    theirs = {
        n: ec.identify(replace(whole, prior=m), [log(SLOW)], others).validations[1:]
        for n, m in models.items()
    }
    beside = "; ".join(f"model {n}: {rms_of_prior(part, m)}" for n, m in models.items())
    line = summary(
        "double pendulum",
        "last third of the log",
        held.validations[1].scores,
        f"rms of {beside}",
    )
    rows = [
        [
            run,
            figures(column(ours[k].scores, "rms")),
            *(figures(column(runs[k].prior_scores, "rms")) for runs in theirs.values()),
            *(
                f"{100 * (total(ours[k].scores) / total(runs[k].prior_scores) - 1):+.0f} %"
                for runs in theirs.values()
            ),
        ]
        for k, run in enumerate(RUNS)
    ]
    names = [
        "run",
        "rms of the fit",
        *(f"model {n}" for n in models),
        *(f"fit against {n}" for n in models),
    ]
    alone = changed(setup, holdout=0.0, physical=False, predict="estimate")
    moments = [
        (run, ec.identify(alone, [log(f"double_pendulum/{run}.parquet")]))
        for run in (SLOW_RUN, *FAST)
    ]
    own = table(
        ["fitted to", "MX1 + l1·M2 (kg·m)", "Fc1 (N·m)"],
        [[n, interval(r, "MX1"), interval(r, "Fc1")] for n, r in moments],
    )
    text = (
        "Fitted to the whole slow run, judged on others (joint 1 · joint 2, N·m), published models beside; the last "
        "columns compare the rms of both joints.  In all but the first two runs 99 % of the torques are below 0.9 N·m; "
        "in the last one torques are commands."
    )
    more = "Gravity moment and Coulomb friction of joint 1 by fits to single runs alone, with 95 % intervals:"
    blocks = [outputs_table(held.validations), text, table(names, rows), more, own]
    return Section("Double pendulum", [line], blocks)


def rms_of_prior(setup: ec.Setup, prior: ec.Mechanism) -> str:
    """Of what is held out of the slow run."""
    scores = (
        ec.identify(replace(setup, prior=prior), [log(SLOW)])
        .validations[1]
        .prior_scores
    )
    return figures(column(scores, "rms"))


def total(scores: Sequence[Any]) -> float:
    """The rms of all outputs together."""
    return float(np.linalg.norm(column(scores, "rms")))


def published_pendulum(setup: ec.Setup, model: str) -> ec.Mechanism:
    """A published model of design A.0 as a prior; friction cf atan(100 q̇) is Coulomb friction of cf π/2.

    Its viscous friction has no counterpart in the set-up and is left out.  In the plane only ZZ counts; the other
    moments are those of a body so flat and thin that it can exist.
    """
    p = yaml.safe_load(
        log(f"double_pendulum/params/design_A.0_model_{model}.yml").read_text()
    )
    flat = 0.02
    links = [(p[f"I{k}"], p[f"m{k}"] * p[f"r{k}"], p[f"m{k}"]) for k in (1, 2)]
    ten = [
        (2 * flat * zz, 0.0, 0.0, zz, 0.0, zz, mx, 0.0, 0.0, m) for zz, mx, m in links
    ]
    known = {"Ir": p["Ir"], "Fc1": p["cf1"] * np.pi / 2, "Fc2": p["cf2"] * np.pi / 2}
    robot = setup.mechanism
    bodies = tuple(
        replace(body, inertial=some)
        for body, some in zip(robot.bodies, ten, strict=True)
    )
    effects = tuple(
        replace(effect, value=known.get(effect.parameter, 0.0))
        for effect in robot.effects
    )
    return replace(robot, name=f"model {model}", bodies=bodies, effects=effects)


def panda() -> Section:
    """Seven joints with torque sensors; two arms."""
    setup = changed(ec.load_setup(EXAMPLES / "logs" / "panda.yaml"), physical=False)
    own, other = (
        log("panda_1khz/panda_gaz_exciting_1kHz.parquet"),
        log("panda_30hz/panda_exciting.parquet"),
    )
    held, whole = ec.identify(setup, [own]), ec.identify(setup, [own], [other])
    scores = whole.validations[1].scores
    apart = " · ".join(f"{s.r2_without_bias:.3f}" for s in scores)
    independent = "R² of an independent fit: 0.998 · 0.9999 · 0.9999 · 0.9985 · 0.997 · 0.997 · 0.969"
    lines = [
        summary(
            "Panda", "last 30 % of the log", held.validations[1].scores, independent
        ),
        summary(
            "Panda, another arm",
            "a log of 30 Hz",
            scores,
            f"R² apart from a constant: {apart}",
        ),
    ]
    blocks = [
        "Fitted to the first 70 % of the log of 1 kHz:",
        outputs_table(held.validations),
    ]
    blocks += [
        "Fitted to all of it, judged on another arm:",
        outputs_table(whole.validations),
    ]
    return Section("Franka Panda", lines, [*blocks, first_joint(setup, whole, other)])


def first_joint(setup: ec.Setup, whole: ec.Identification, other: Path) -> str:
    """What differs between the arms' first joints: only its friction and offset are fitted to the other arm."""
    ours = values(whole)
    free = ("Fv1", "Fo1")
    known = {name: value for name, value in ours.items() if name not in free}
    found = ec.identify(
        changed(
            replace(setup, preparation=whole.preparation),
            known=known,
            holdout=0.0,
            essential="none",
        ),
        [other],
    )
    theirs = values(found)
    before, after = whole.validations[1].scores[0], found.validations[0].scores[0]
    spread = before.rms / np.sqrt(1 - before.r2)
    friction, offset = (theirs[name] - ours[name] for name in free)
    return (
        f"Joint 1 of the other arm: its axis is along gravity and its torque varies by {spread:.2f} N·m only (standard "
        f"deviation), of which the error of {before.rms:.2f} N·m is {before.rms / spread:.0%}.  With viscous friction "
        f"and offset of this joint fitted to the other arm and all else kept, friction differs by {friction:+.2f} "
        f"N·m·s/rad and the offset by {offset:+.2f} N·m, and the rms falls to {after.rms:.2f} N·m (R² {after.r2:.3f})."
    )


def lwr4() -> Section:
    """Seven joints, poorly excited: what physics and a prior add."""
    setup = ec.load_setup(
        EXAMPLES / "logs" / "lwr4.yaml", prior=log("kuka_lwr4/model/kuka_lwr4.urdf")
    )
    first, third = (log(f"kuka_lwr4/lwr4_measurements_{k}.parquet") for k in (1, 3))
    physical = ec.identify(setup, [first], [third])
    plain = (
        ec.identify(changed(setup, predict="estimate"), [first], [third])
        .validations[1]
        .scores
    )
    unseen = physical.validations[1]
    prior = figures(column(unseen.prior_scores, "rms"))
    beside = (
        f"rms of the URDF: {prior}; of least squares: {figures(column(plain, 'rms'))}"
    )
    line = summary(
        "LWR4+, physical, URDF as prior", "another trajectory", unseen.scores, beside
    )
    rows = [
        [
            s.output,
            f"{s.rms:.3g}",
            f"{p.rms:.3g}",
            f"{u.rms:.3g}",
            f"{s.r2:.3f}",
            f"{p.r2:.3f}",
            f"{u.r2:.3f}",
        ]
        for s, p, u in zip(unseen.scores, plain, unseen.prior_scores, strict=True)
    ]
    head = [
        "set 3",
        "rms of the physical fit",
        "least squares",
        "URDF",
        "R² of the physical fit",
        "least squares",
    ]
    fit = physical.physical
    text = (
        f"Weight of the prior, chosen from the data of the fit: {fit.prior_weight:g}."
        if fit is not None
        else ""
    )
    return Section(
        "KUKA LWR4+",
        [line],
        [table([*head, "URDF"], rows), text, outputs_table(physical.validations)],
    )


# -- the page ----------------------------------------------------------------------------------------------------------


def page(sections: Sequence[Section], versions: Mapping[str, str]) -> str:
    """All as Markdown."""
    stated = ", ".join(f"{name} {text}" for name, text in versions.items())
    lines = [row for section in sections for row in section.summary]
    head = f"# Identification from measured logs\n\n{stated}.  Set-ups in examples/; outputs in the order of the joints."
    blocks = [head, *summary_tables(lines)]
    for section in sections:
        blocks += [f"## {section.title}", *section.blocks]
    return "\n\n".join(block for block in blocks if block) + "\n"


def main() -> None:
    """Identify all robots and write the page."""
    try:
        sections = [robot() for robot in (emps, tx40, pendulum, panda, lwr4)]
    except AbsentError as error:
        print(f"skipped: {error} (set ECHELON_DATA to the folder of the logs)")
        return
    versions = {"Echelon": ec.__version__, "Python": platform.python_version()}
    versions |= {name: version(name) for name in ("numpy", "scipy", "clarabel")}
    text = page(sections, versions)
    OUTPUT.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
