"""Logs of experiments: which experiment every log is of, and the experiments that changing contacts make of one log.

A log says by its file name, by the set-up or by where it is given which experiment it is of.  The base parameters are
those of the experiments that have logs.  A robot that walks makes another experiment with every set of feet that touch,
and columns of the log say when.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from echelon.identification.logs.columns.conversion import touching
from echelon.identification.logs.files.open_log import log_paths
from echelon.identification.logs.finding import listed
from echelon.identification.logs.read_log import map_of, opened, read_log
from echelon.identification.setup.setup import Setup
from echelon.robot import Experiment
from echelon.shared import InputError, in_quotes, nearest_of

RARE = 0.1
"""Share of the samples below which a set of contacts is no experiment of its own, as where feet bounce: its samples are
those of a larger set, which is right whatever forces act."""

Paths = tuple[Path, ...]


def by_experiment(logs: Any, names: Sequence[str]) -> Iterator[tuple[str, Path]]:
    """Paths of logs with the experiment that they are given for, in a mapping from its name; else with none."""
    is_told = isinstance(logs, Mapping) and any(name in names for name in logs)
    if is_told and (strange := [name for name in logs if name not in names]):
        near = nearest_of(str(strange[0]), names)
        raise InputError(
            f"logs are given for '{strange[0]}', which is no experiment{near}"
        )
    for name, some in logs.items() if is_told else [("", logs)]:
        for path in log_paths(some):
            yield name, path


def told_apart(setup: Setup, fitted: Paths, unseen: Paths) -> Setup:
    """The set-up with those of its experiments that logs are of; others have nothing to say of parameters."""
    told = {
        path: map_of(opened(path), setup.columns).experiment
        for path in (*fitted, *unseen)
    }
    used = {told[path] for path in fitted}
    if "" in used:  # contacts tell
        return setup
    for path in unseen:
        if told[path] not in used:
            raise InputError(
                f"it is of experiment '{told[path]}', of which no log is fitted: give one (fitted: {listed(used)})",
                source=str(path),
            )
    kept = [e for e in setup.experiments if e.name in used]
    gone = [e.name for e in setup.experiments if e.name not in used]
    if not gone:
        return setup
    note = f"no log is of the experiments {in_quotes(gone)}, which are left out"
    found = replace(setup, assumed=(*setup.assumed, note)).of_experiments(kept)
    return found.of_single() if len(kept) == 1 else found


def with_phases(setup: Setup, paths: Paths) -> Setup:
    """The set-up with an experiment for every set of contacts that touch in the logs, where columns tell that."""
    names = [contact.name for contact in setup.mechanism.contacts]
    if not names or not any(some.contacts for some in setup.columns):
        return setup
    counts = Counter[tuple[bool, ...]]()
    for path in paths:
        for piece in read_log(path, setup.mechanism, setup.columns, named=False):
            flags, number = np.unique(
                touching(piece.recording.inputs, names), axis=0, return_counts=True
            )
            found = map(tuple, flags.tolist())
            counts.update(dict(zip(found, number.tolist(), strict=True)))
    total = counts.total()
    common = [some for some, count in counts.most_common() if count >= RARE * total]
    sets = dict.fromkeys([(True,) * len(names), *common])
    if len(sets) == 1:
        return setup
    experiments = []
    for some in sets:
        chosen = [name for name, flag in zip(names, some, strict=True) if flag]
        title = re.sub(r"\W", "_", "_".join(chosen)) or "air"
        experiments.append(Experiment(setup.mechanism, title, contacts=chosen))
    text = f"contacts touch together as {in_quotes([e.name for e in experiments])}, each an experiment; rarer sets count "
    text += "as larger ones"
    return replace(setup, assumed=(*setup.assumed, text)).of_experiments(experiments)
