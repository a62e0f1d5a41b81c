"""Some cases of `make fuzz`, and that it notices what it looks for."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from fuzz.cases import prepared, run_case
from fuzz.child import MEMORY, SECONDS, Outcome, run_alone
from fuzz.formats import FORMATS
from fuzz.material import Material

SEED = 17


@pytest.fixture(scope="module")
def material(tmp_path_factory: pytest.TempPathFactory) -> Material:
    return prepared(tmp_path_factory.mktemp("fuzz"))


@pytest.mark.parametrize(
    "number", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in range(1, 5))]
)
@pytest.mark.parametrize("kind", FORMATS)
def test_mutated_files_end_in_an_answer_or_an_error(
    kind: str, number: int, material: Material
) -> None:
    fault = run_case(material, kind, number, SEED)
    assert fault is None, str(fault)


def raised() -> int:
    raise ZeroDivisionError


def kept_busy() -> int:
    while True:
        pass


def killed() -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(60)
    return 0


@pytest.mark.parametrize(
    ("act", "fault"),
    [
        (lambda: 2, ""),
        (lambda: 70, "exit code 70"),
        (raised, "exit code 99"),
        (killed, "exit code -9"),
        pytest.param(kept_busy, f"more than {SECONDS} s", marks=pytest.mark.slow),
    ],
)
def test_faults_are_noticed(act: object, fault: str, tmp_path: Path) -> None:
    found = run_alone(act, tmp_path / "printed").fault  # type: ignore[arg-type]
    assert found.endswith(fault)
    assert bool(found) == bool(fault)


def test_memory_and_tracebacks_are_noticed() -> None:
    assert Outcome(0, 1.0, MEMORY, "fine").fault == ""
    assert Outcome(0, 1.0, MEMORY + 1, "fine").fault == "1024 MB"
    assert (
        Outcome(2, 1.0, 0, "Traceback (most recent call last):\n").fault
        == "a traceback"
    )
