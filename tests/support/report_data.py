"""An identification with known ingredients: a real model, its true outputs, noise, and results as a fit would give."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import numpy.typing as npt

import echelon as ec
from echelon.identification.conditioning import DataConditioning, Direction
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.logs.finding import Finding, Severity
from echelon.identification.logs.preparation.prepare import Preparation
from echelon.identification.physics.feasibility import Feasibility
from echelon.identification.physics.fit import PhysicalFit
from echelon.identification.result import Identification
from echelon.identification.scores import Score, Trace, Validation, fit
from echelon.identification.verdict import Judgement
from support.derived import base_of
from support.unchecked_names import unchecked_names

Floats = npt.NDArray[np.float64]


def bodies(base: ec.BaseModel, rng: np.random.Generator) -> Floats:
    """Standard parameters of a robot that can exist: light solid bodies, friction where there is any."""
    columns = base.mechanism.columns
    zeta = np.abs(rng.normal(1.0, 0.2, len(columns)))
    for start in base.mechanism.first_column.values():
        mass, centre = rng.uniform(0.5, 3.0), rng.uniform(-0.1, 0.1, 3)
        tensor = np.diag(rng.uniform(0.6, 1.0, 3)) * 0.01 * mass
        ten = ec.convert(
            [mass, *centre, *tensor[np.triu_indices(3)]], "urdf", "echelon"
        )
        kinds = [
            p.kind
            for p in columns
            if p.body is not None and p.body == columns[start].body
        ]
        zeta[start : start + len(kinds)] = [ten[k] for k in kinds if k is not None]
    return zeta


def motion(
    base: ec.BaseModel, time: Floats, rng: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    n = len(base.mechanism.velocities)
    q, qd, qdd = (np.zeros((len(time), n)) for _ in range(3))
    for harmonic in range(1, 5):
        a, b = rng.normal(0, 1.0 / harmonic, (2, n))
        w = 2 * np.pi * 0.11 * harmonic
        s, c = np.sin(w * time)[:, None], np.cos(w * time)[:, None]
        q += a * s + b * c
        qd += w * (a * c - b * s)
        qdd += -w * w * (a * s + b * c)
    return q, qd, qdd


ROW = 5  # samples of a row, as a filter leaves them


def score(trace: Trace, predicted: Floats) -> Score:
    found, raw = (
        fit(trace.measured, predicted),
        fit(trace.raw.measured, trace.raw.predicted),
    )
    return Score(trace.output, trace.unit, found, found, raw, 0.01, 0.013, 0.2)


def validation(
    base: ec.BaseModel,
    values: Floats,
    zeta: Floats,
    source: str,
    role: str,
    samples: int,
    rng: np.random.Generator,
    prior: bool = True,
) -> Validation:
    time = np.arange(samples) / 250.0
    state = motion(base, time, rng)
    truth = base.predict(*state, base.values(zeta))
    noise = rng.normal(0, 0.02 * truth.std(axis=0) + 1e-3, truth.shape)
    predicted = base.predict(*state, values)
    before = base.predict(*state, 0.8 * base.values(zeta))

    def traces_of(rows: slice, noise: Floats) -> list[Trace]:
        return [
            Trace(
                o.name,
                o.unit,
                time[rows],
                (truth + noise)[rows, k],
                predicted[rows, k],
                before[rows, k] if prior else None,
            )
            for k, o in enumerate(base.mechanism.outputs)
        ]

    raw = traces_of(slice(None), 3 * noise)
    pairs = zip(traces_of(slice(None, None, ROW), noise), raw, strict=True)
    traces = tuple(replace(trace, raw=some) for trace, some in pairs)
    scores = tuple(score(t, t.predicted) for t in traces)
    prior_scores = tuple(score(t, t.prior) for t in traces if t.prior is not None)
    words = f"All {len(traces)} outputs are predicted within 3 % of their range."
    return Validation(source, role, scores, prior_scores, (), traces, words)


def estimate_of(base: ec.BaseModel, values: Floats, std: Floats, rows: int) -> Estimate:
    outputs = tuple(o.name for o in base.mechanism.outputs)
    m = len(outputs)
    return Estimate(
        "irls", base.pivots, base.units, values, np.diag(std**2), outputs, np.full(m, 0.05), (rows,) * m,
        float(m * rows - len(values)), {"iterations": 6, "condition": 84.2},
    )  # fmt: skip


def conditioning_of(base: ec.BaseModel, rng: np.random.Generator) -> DataConditioning:
    r = base.rank
    values = np.logspace(0, -2.3, r)
    weights = tuple(
        (name, w) for name, w in zip(base.pivots[:3], (0.83, -0.5, 0.21), strict=False)
    )
    weak = (
        Direction(
            float(values[-1]),
            weights,
            "Move joints 1 and 2 at the same time, and faster.",
        ),
    )
    return DataConditioning(742.0, 199.5, values, r, rng.uniform(0.03, 1.0, r), weak)


def physical_of(base: ec.BaseModel, zeta: Floats) -> PhysicalFit:
    units = tuple(c.unit for c in base.mechanism.columns)
    margins = {b.name: 0.1 + 0.05 * k for k, b in enumerate(base.mechanism.bodies)}
    return PhysicalFit(
        base.parameters, units, zeta, base.values(zeta), 104.0, 101.0, margins, "panda.urdf", 1e-3, "optimal",
        {"solver": "clarabel", "iterations": 14},
    )  # fmt: skip


FINDINGS = (
    Finding(
        Severity.WARNING,
        "gap",
        "run1.parquet, 12.31 s",
        "0.4 s are missing; the log was cut in two there.",
    ),
    Finding(
        Severity.NOTE,
        "jitter",
        "run1.parquet",
        "Time stamps jitter by 0.3 ms; the log was resampled to 250 Hz.",
    ),
    Finding(
        Severity.WARNING,
        "saturation",
        "run2.parquet, j2",
        "212 samples are at the limit of 87 N·m; left out.",
    ),
)

PREPARATION = Preparation(
    band=20.0,
    measured=(),
    still={"j1": 0.02, "j2": 0.01},
    delays={"j1": 0.004},
    rate=250.0,
    reasons={
        "band": "12 times 1.7 Hz, the mean frequency of the velocity of j1",
        "rate": "that of the log",
    },
)


def identification(
    robot: str = "double_pendulum", samples: int = 2500, seed: int = 1
) -> Identification:
    """Everything there is: two logs, a prior, essential parameters, a physical fit and findings."""
    base, rng = base_of(robot), np.random.default_rng(seed)
    zeta = bodies(base, rng)
    truth = base.values(zeta)
    std = 0.004 * np.abs(truth) + 1e-4
    values = truth + rng.normal(0, 1, len(truth)) * std
    essential = np.where(np.abs(values) > 4 * std, values, 0.0)
    return Identification(
        base,
        ("run1.parquet",),
        PREPARATION,
        estimate_of(base, values, std, samples),
        replace(estimate_of(base, essential, std, samples), method="irls, essential"),
        conditioning_of(base, rng),
        Feasibility(False, "An exact separating vector was verified in rational arithmetic.",
                    nearest=truth, distance=1.7),
        physical_of(base, zeta),
        (
            validation(base, values, zeta, "run1.parquet", "identification", samples, rng),
            validation(base, values, zeta, "run2.parquet", "validation", samples, rng),
        ),
        FINDINGS,
        "physical",
        Judgement("good", f"The model predicts all {len(base.mechanism.outputs)} joints well.",
                  gaps=("the data leave j1 open",), remarks=("Check it on other data.",)),
        {"seed": 2015, "versions": {"echelon": "0.1", "numpy": "2.3"}, "estimator": "irls"},
    )  # fmt: skip


def bare(robot: str = "double_pendulum", samples: int = 400) -> Identification:
    """The least there can be: no data kept back, no prior, no physical fit, nothing found."""
    full = identification(robot, samples)
    first = full.validations[0]
    lone = replace(
        first,
        prior_scores=(),
        traces=tuple(replace(t, prior=None) for t in first.traces),
        verdict="",
    )
    return replace(
        full, essential=None, feasibility=None, physical=None, validations=(lone,), findings=(),
        predict_with="estimate", preparation=Preparation(),
        conditioning=replace(full.conditioning, weak=()), settings={}, judgement=Judgement("usable", "The model is usable."),
    )  # fmt: skip


# -- pages and hostile names -------------------------------------------------------------------------------------------

HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>\n</script><!-- 🦾 \u202eمرحبا {{ 7 * 7 }} %{y} $x$ &lt;"


class Page(HTMLParser):
    """Elements, attributes and texts of a page; a script's content is text."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.text: list[str] = []
        self.open: list[str] = []
        self._inside = ""
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._inside = tag
        if tag == "script":
            self.scripts.append("")
        if tag not in ("meta", "link", "input", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside == "script":
            self.scripts[-1] += data
        else:
            self.text.append(data)

    @property
    def words(self) -> str:
        return " ".join(" ".join(self.text).split())


def hostile(run: Identification) -> Identification:
    """Copy of an identification with names that try to break out, wherever a name can stand."""
    mechanism = run.base.mechanism
    bodies = tuple(
        replace(
            b,
            name=f"{HOSTILE}{k}",
            label=f"<b>{k}",
            joint=replace(b.joint, name=HOSTILE),
        )
        for k, b in enumerate(mechanism.bodies)
    )
    with unchecked_names():
        other = replace(mechanism, name=HOSTILE, bodies=bodies)
    matrix = replace(run.base.matrix, parameters=other.parameters)
    base = ec.BaseModel(
        other, matrix, run.base.certificate, run.base.reading, run.base.seed
    )

    def dirty(validation):
        scores = tuple(
            replace(s, output=f"{HOSTILE}{k}", unit=HOSTILE)
            for k, s in enumerate(validation.scores)
        )
        traces = tuple(
            replace(t, output=f"{HOSTILE}{k}", unit=HOSTILE)
            for k, t in enumerate(validation.traces)
        )
        return replace(
            validation,
            source=HOSTILE,
            verdict=HOSTILE,
            scores=scores,
            prior_scores=scores,
            traces=traces,
        )

    assert run.physical is not None
    assert run.feasibility is not None
    weak = tuple(
        replace(d, advice=HOSTILE, weights=((base.pivots[0], 1.0),))
        for d in run.conditioning.weak
    )
    margins = {body.name: 1.0 for body in bodies}
    return replace(
        run, base=base, logs=(HOSTILE,), judgement=Judgement("good", HOSTILE, (HOSTILE,), (HOSTILE,), (HOSTILE,)), settings={HOSTILE: HOSTILE},
        findings=(Finding(Severity.WARNING, HOSTILE, HOSTILE, HOSTILE),),
        validations=tuple(dirty(v) for v in run.validations),
        estimate=replace(run.estimate, method=HOSTILE, units=(HOSTILE,) * run.base.rank, diagnostics={HOSTILE: 1}),
        conditioning=replace(run.conditioning, weak=weak),
        feasibility=replace(run.feasibility, evidence=HOSTILE),
        physical=replace(run.physical, parameters=other.parameters, margins=margins, prior=HOSTILE, status=HOSTILE),
        preparation=run.preparation.model_copy(update={"still": {HOSTILE: 1.0}, "reasons": {"still": HOSTILE}}),
    )  # fmt: skip
