"""Several starts of the solver, each in a process of its own.

Processes are started as ``python -m`` this module with a pickled problem on their input: unlike those of
multiprocessing they never import the caller's script a second time.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from tempfile import TemporaryFile
from threading import Lock, Thread
from typing import TYPE_CHECKING

import numpy as np

from echelon.errors import EchelonError
from echelon.excite.problem.optimisation import Problem
from echelon.excite.solve.solver import Solution, constraint_generation

if TYPE_CHECKING:  # processes of the solver need no schemas
    from echelon.formats.schema.schema_excite import ExcitationEntry


def solutions(
    problem: Problem, entry: ExcitationEntry, jobs: int, step: Callable[[str], None] = lambda _: None
) -> list[Solution]:
    """Solutions from random starts: the same for the same seed, whatever the number of processes."""
    count, seed, iterations = entry.starts, entry.seed, entry.iterations

    def tell(k: int, solution: Solution) -> Solution:
        step(f"start {k + 1} of {count}: {solution.status}, criterion {solution.value:.5g}")
        return solution

    if count == 1:
        return [tell(0, started(problem, seed, iterations, 0))]
    document, processes = pickle.dumps((problem, seed, iterations)), _Processes()

    def run(k: int) -> Solution:
        return tell(k, processes.solution(document, k))

    with ThreadPoolExecutor(max(min(jobs, count), 1)) as pool:
        try:
            return list(pool.map(run, range(count)))
        except BaseException:
            processes.end()
            raise


def started(problem: Problem, seed: int, iterations: int, k: int) -> Solution:
    """One start."""
    return constraint_generation(problem, problem.start(np.random.default_rng([seed, k])), iterations)


class _Processes:
    """Processes that solve, which can be ended together."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._running: set[subprocess.Popen[bytes]] = set()
        self._ended = False

    def solution(self, document: bytes, k: int) -> Solution:
        """Solution from start ``k``."""
        # the packages that this process found, wherever it found them
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
        command = [sys.executable, "-m", "echelon.excite.solve.starts", str(k)]
        with TemporaryFile() as errors:
            with self._lock:
                if self._ended:
                    raise EchelonError("the starts of the solver were ended")
                process = subprocess.Popen(
                    command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, env=environment
                )
                self._running.add(process)
            answer = b""
            with suppress(BrokenPipeError), process:  # it ended early, which its exit code says
                answer = _answer(process, document)
            with self._lock:
                self._running.discard(process)
            errors.seek(0)
            if process.returncode:
                said = errors.read().decode(errors="replace").strip()[-500:]
                raise EchelonError(f"a start of the solver ended early: {said}")
        found = pickle.loads(answer)
        if isinstance(found, EchelonError):
            raise found
        assert isinstance(found, Solution)
        return found

    def end(self) -> None:
        """End all, and start no others."""
        with self._lock:
            self._ended = True
            for process in self._running:
                process.kill()


def _answer(process: subprocess.Popen[bytes], document: bytes) -> bytes:
    """Output of a process; its input stays open until it has ended."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(document)
    process.stdin.flush()
    answer = process.stdout.read()
    process.wait()
    return answer


def _work() -> None:
    """Solve what comes in, and write the solution, or what was wrong with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # what a terminal sends to all is for the first process to answer
    problem, seed, iterations = pickle.load(sys.stdin.buffer)
    Thread(target=_end_with_parent, daemon=True).start()
    # libraries that print, in Python or not, must not spoil the answer
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    try:
        found: Solution | EchelonError = started(problem, seed, iterations, int(sys.argv[1]))
    except EchelonError as error:
        found = error
    out.write(pickle.dumps(found))
    out.flush()


def _end_with_parent() -> None:
    """Wait for the end of the input, which comes when the process that started this one ends, however it does."""
    while os.read(0, 1):  # not through sys.stdin, which would be locked when the interpreter ends
        pass
    os._exit(1)


if __name__ == "__main__":
    _work()
