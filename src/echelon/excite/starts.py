"""Several starts of the solver, each in a process of its own.

Processes are started as ``python -m echelon.excite.starts`` with a pickled problem on their input: unlike those of
multiprocessing they never import the caller's script a second time.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from echelon.errors import EchelonError
from echelon.excite.lazy import Solution, solve_lazily
from echelon.excite.problem import Problem
from echelon.excite.solver import SolverOptions

OnEnd = Callable[[int, Solution], None]
"""Told the number of a start and where it ended."""


def solutions(
    problem: Problem, count: int, seed: int, iterations: int, jobs: int, on_end: OnEnd | None = None
) -> list[Solution]:
    """Solve from random starting points.

    Parameters
    ----------
    problem : Problem
    count : int
        Number of starts.
    seed : int
        Of the starting points.
    iterations : int
        Of each start, at most.
    jobs : int
        Processes that run at the same time.
    on_end : callable, optional

    Returns
    -------
    list of Solution
        The same for the same seed, whatever the number of processes.
    """
    tell = on_end or (lambda _k, _solution: None)
    if count == 1:
        found = started(problem, seed, iterations, 0)
        tell(0, found)
        return [found]
    document = pickle.dumps((problem, seed, iterations))

    def run(k: int) -> Solution:
        solution = _in_process(document, k)
        tell(k, solution)
        return solution

    with ThreadPoolExecutor(max(min(jobs, count), 1)) as pool:
        return list(pool.map(run, range(count)))


def started(problem: Problem, seed: int, iterations: int, k: int) -> Solution:
    """One start.

    Parameters
    ----------
    problem : Problem
    seed : int
    iterations : int
        At most so many.
    k : int
        Number of the start.
    """
    return solve_lazily(problem, problem.start(np.random.default_rng([seed, k])), SolverOptions(iterations=iterations))


def _in_process(document: bytes, k: int) -> Solution:
    # the packages that this process found, wherever it found them
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-m", "echelon.excite.starts", str(k)]
    done = subprocess.run(command, input=document, capture_output=True, env=environment, check=False)
    if done.returncode:
        raise EchelonError(f"a start of the solver ended early: {done.stderr.decode(errors='replace').strip()[-500:]}")
    found = pickle.loads(done.stdout)
    if isinstance(found, EchelonError):
        raise found
    assert isinstance(found, Solution)
    return found


def _work() -> None:
    """Solve what comes in, and write the solution, or what was wrong with it."""
    problem, seed, iterations = pickle.loads(sys.stdin.buffer.read())
    # libraries that print, in Python or not, must not spoil the answer
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    try:
        found: Solution | EchelonError = started(problem, seed, iterations, int(sys.argv[1]))
    except EchelonError as error:
        found = error
    out.write(pickle.dumps(found))
    out.flush()


if __name__ == "__main__":
    _work()
