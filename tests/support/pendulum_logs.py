"""Logs of a simulated double pendulum, as many and as long as a test wants."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

import echelon as ec
from echelon.identification.logs.columns.column_map import Channel, ColumnMap
from echelon.identification.logs.preparation.prepare import Preparation
from echelon.identification.setup.setup import Setup
from support.paths import ROOT

RATE = 200.0
PREPARATION = Preparation(
    band=8.0, measured=(), still=0.02, delays={}, reasons={"all": "stated by the test"}
)


def pendulum(**changed: object) -> Setup:
    """A set-up whose preparation is stated, without a physical fit."""
    mechanism = ec.load(ROOT / "examples" / "double_pendulum.yaml")
    positions = {name: Channel(f"q{k}") for k, name in enumerate(mechanism.positions)}
    outputs = {
        output.name: Channel(f"tau{k}") for k, output in enumerate(mechanism.outputs)
    }
    columns = ColumnMap(time=Channel("t"), positions=positions, outputs=outputs)
    found = Setup("pendulum", mechanism, (columns,), PREPARATION, **changed)  # type: ignore[arg-type]
    return found.with_settings(physical=False, essential="none")


def write_log(path: Path, samples: int, seed: int) -> npt.NDArray[np.float64]:
    """A log with noise; the true base parameters."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    base = ec.base_parameters(pendulum().mechanism)
    truth = np.random.default_rng(1).uniform(0.5, 2.0, base.rank)
    rng = np.random.default_rng(seed)
    t = np.arange(samples) / RATE
    q, qd, qdd = np.zeros((3, samples, 2))
    for joint in range(2):
        for frequency in rng.uniform(0.2, 1.5, 5):
            w, phase, size = (
                2 * np.pi * frequency,
                rng.uniform(0, 7),
                rng.uniform(0.2, 0.6),
            )
            q[:, joint] += size * np.sin(w * t + phase)
            qd[:, joint] += size * w * np.cos(w * t + phase)
            qdd[:, joint] -= size * w**2 * np.sin(w * t + phase)
    y = base.predict(q, qd, qdd, truth)
    y = y + 0.02 * y.std(axis=0) * rng.standard_normal(y.shape)
    columns = {
        "t": t,
        **{f"q{k}": q[:, k] for k in range(2)},
        **{f"tau{k}": y[:, k] for k in range(2)},
    }
    pq.write_table(pa.table(columns), path)
    return truth


def write_logs(
    folder: Path, count: int, samples: int = 4000
) -> npt.NDArray[np.float64]:
    """A directory of logs; the true base parameters."""
    folder.mkdir(exist_ok=True)
    truth = [
        write_log(folder / f"run{k}.parquet", samples, seed=k) for k in range(count)
    ]
    return truth[0]
