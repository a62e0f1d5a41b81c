"""The solver: IPOPT through CasADi, with exact gradients and constraint generation, from several starts.

Most limits of accelerations, jerks and torques never bind, and every one costs the solver a row at every sample.  So
the first problem has limits of positions and velocities only; limits that its solution breaks are added, and the search
goes on from the best motion that keeps everything.

Each start has a process of its own.  Processes are started as ``python -m`` this module with a pickled problem on their
input: unlike those of multiprocessing they never import the caller's script a second time.
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
from dataclasses import dataclass, field
from tempfile import TemporaryFile
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.excite.problem.optimisation import BROKEN, Problem, beyond
from echelon.shared import EchelonError, Floats, extra, one_thread

if TYPE_CHECKING:  # processes of the solver need no schemas
    from echelon.formats import ExcitationEntry


_OPTIONS = {
    "ipopt.hessian_approximation": "limited-memory",
    "ipopt.limited_memory_max_history": 8,
    "ipopt.mu_strategy": "adaptive",
    "ipopt.linear_solver": "mumps",
    # quasi-definite systems need no scaling, which takes as long as their factorisation
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_scaling": 0,
    "ipopt.sb": "yes",
    "ipopt.print_level": 0,
    "ipopt.honor_original_bounds": "yes",
    "print_time": False,
}


_CREEPING = 0.25  # share of the tolerance below which relative changes of the criterion count as none


_TOLERANCE = 2e-4  # of optimality; ten times as much does where the criterion does not get better by a quarter of it


_STATUS = {
    "Solve_Succeeded": "converged",
    "Solved_To_Acceptable_Level": "converged",
    "Maximum_Iterations_Exceeded": "iterations",
    "Infeasible_Problem_Detected": "infeasible",
}


@dataclass
class Best:
    """The best motion so far."""

    problem: Problem  # whose limits it keeps, all of them, whatever the solver knows of
    x: Floats | None = None
    value: float = np.inf
    history: list[float] = field(
        default_factory=list
    )  # values, each time a better one was found

    def offer(self, x: Floats, value: float) -> None:
        """Take a motion if it is better and keeps all limits at the samples."""
        if value < self.value and self.problem.violation(x) <= BROKEN:
            self.x, self.value = x.copy(), value
            self.history.append(value)


class _LastEvaluation:
    """The last evaluation, because a solver asks for derivatives where it asked for a value, but not everywhere."""

    def __init__(self, function: Callable[[Floats], Any]) -> None:
        self._function, self._x, self._found = function, np.zeros(0), None

    def __call__(self, x: Floats) -> Any:
        if not np.array_equal(x, self._x):
            self._found, self._x = self._function(x), x.copy()
        return self._found


def solve(
    problem: Problem, start: Floats, iterations: int, best: Best
) -> tuple[Floats, str, int]:
    """Minimise from one starting point: the last iterate, which keeps the limits of the problem if it converged.

    Beside it stand ``"converged"``, ``"iterations"``, ``"infeasible"`` or the solver's own word, and the iterations.
    """
    casadi = _casadi()
    evaluate = _LastEvaluation(problem.value_and_gradient)
    A, low, high = problem.linear
    least, most = problem.bounds
    x = casadi.MX.sym("x", problem.size)
    objective = _callback(casadi, "criterion", problem.size, 1, evaluate)
    columns = A.tocsc()
    pattern = casadi.Sparsity(
        *columns.shape, columns.indptr.tolist(), columns.indices.tolist()
    )
    parts = [casadi.mtimes(casadi.DM(pattern, columns.data), x)]
    if least.size:
        both = _LastEvaluation(
            lambda v: (problem.constrained(v), lambda: problem.slopes(v))
        )
        constraints = _callback(casadi, "constraints", problem.size, least.size, both)
        parts.append(constraints(x))
    ends = np.concatenate([low, least]), np.concatenate([high, most])
    watch = _watch(casadi, problem.size, ends, best)
    settings = _OPTIONS | {
        "ipopt.tol": _TOLERANCE,
        "ipopt.acceptable_tol": 10 * _TOLERANCE,
        "ipopt.acceptable_obj_change_tol": _CREEPING * _TOLERANCE,
        "ipopt.acceptable_iter": 5,
        "ipopt.constr_viol_tol": BROKEN / 10,
        "ipopt.acceptable_constr_viol_tol": BROKEN / 10,
        "ipopt.max_iter": iterations,
        "iteration_callback": watch,
    }
    limited = casadi.densify(casadi.vertcat(*parts))  # some may be constantly zero
    solver = casadi.nlpsol(
        "excite", "ipopt", {"x": x, "f": objective(x), "g": limited}, settings
    )
    result = solver(x0=start, lbg=ends[0], ubg=ends[1])
    found = np.asarray(result["x"]).ravel()
    best.offer(found, evaluate(found)[0])
    stats = solver.stats()
    status = _STATUS.get(
        stats["return_status"], stats["return_status"].replace("_", " ").lower()
    )
    return found, status, int(stats["iter_count"])


def _casadi() -> Any:
    with extra("excite"):
        import casadi
    return casadi


def _callback(
    casadi: Any, name: str, unknowns: int, size: int, evaluate: Callable[[Floats], Any]
) -> Any:
    """A function of ours with its Jacobian, for CasADi."""

    class Jacobian(casadi.Callback):  # type: ignore[misc]
        def __init__(self, name: str, options: Any) -> None:
            casadi.Callback.__init__(self)
            self.construct(name, options)

        def get_n_in(self) -> int:
            return 2

        def get_sparsity_in(self, i: int) -> Any:
            return casadi.Sparsity.dense(unknowns if i == 0 else size, 1)

        def get_sparsity_out(self, _: int) -> Any:
            return casadi.Sparsity.dense(size, unknowns)

        def eval(self, given: Any) -> Any:
            return [
                np.reshape(
                    evaluate(np.asarray(given[0]).ravel())[1](), (size, unknowns)
                )
            ]

    class Value(casadi.Callback):  # type: ignore[misc]
        def __init__(self) -> None:
            casadi.Callback.__init__(self)
            self.construct(name, {})

        def get_sparsity_in(self, _: int) -> Any:
            return casadi.Sparsity.dense(unknowns, 1)

        def get_sparsity_out(self, _: int) -> Any:
            return casadi.Sparsity.dense(size, 1)

        def eval(self, given: Any) -> Any:
            return [evaluate(np.asarray(given[0]).ravel())[0]]

        def has_jacobian(self) -> bool:
            return True

        def get_jacobian(self, name: str, _in: Any, _out: Any, options: Any) -> Any:
            self._jacobian = Jacobian(name, options)
            return self._jacobian

    return Value()


def _watch(casadi: Any, unknowns: int, ends: tuple[Floats, Floats], best: Best) -> Any:
    """A callback that follows the iterations and remembers the best."""
    rows = len(ends[0])
    sizes = {
        "x": unknowns,
        "f": 1,
        "g": rows,
        "lam_x": unknowns,
        "lam_g": rows,
        "lam_p": 0,
    }

    class Watch(casadi.Callback):  # type: ignore[misc]
        def __init__(self) -> None:
            casadi.Callback.__init__(self)
            self.construct("watch", {})

        def get_n_in(self) -> int:
            return int(casadi.nlpsol_n_out())

        def get_n_out(self) -> int:
            return 1

        def get_name_in(self, i: int) -> str:
            return str(casadi.nlpsol_out(i))

        def get_sparsity_in(self, i: int) -> Any:
            return casadi.Sparsity.dense(sizes[casadi.nlpsol_out(i)], 1)

        def eval(self, given: Any) -> Any:
            # a motion that breaks limits the solver knows of need not be asked about all others
            if (
                beyond(np.asarray(given[2]).ravel(), *ends).max(initial=-np.inf)
                <= BROKEN
            ):
                best.offer(np.asarray(given[0]).ravel(), float(given[1]))
            return [0]  # go on

    return Watch()


_ROUNDS = 8
_SHARES = (0.99, 0.97, 0.94, 0.9, 0.8, 0.65, 0.5)
"""Shares of a motion that breaks limits, of which the largest that keeps them is worth more than none."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The result of one start."""

    x: (
        Floats | None
    )  # the best coefficients that kept all limits at the samples; None if none did
    value: float  # their criterion
    status: str  # see :func:`solve`
    iterations: int
    history: tuple[
        float, ...
    ]  # the criterion of the best motion so far, each time it became better: descending


def constraint_generation(
    problem: Problem, start: Floats, most: int, near: Floats | None = None
) -> Solution:
    """Minimise from one starting point; limits that a motion ``near`` the goal comes near to are enforced at once."""
    # linear algebra runs in one thread: matrices are small, threads that wait for each other cost more than they bring,
    # and the order of additions is the same wherever it runs
    with one_thread():
        best = Best(problem)
        start = problem.inside(
            start
        )  # the centre keeps all limits, so that there is something to fall back on
        best.offer(start, problem.value(start))
        if near is not None:
            _offer_smaller(problem, near, best)
        part, iterations, status = (
            problem.relaxed() if near is None else problem.enforcing(near),
            0,
            "",
        )
        for _ in range(_ROUNDS):
            x, status, steps = solve(part, start, max(most - iterations, 1), best)
            iterations += steps
            _offer_smaller(problem, x, best)
            more = problem.extended(part, x)
            if more is None or iterations >= most:
                break
            part = more
            start = problem.shrunk(x, 0.9) if best.x is None else best.x
    return Solution(best.x, best.value, status, iterations, tuple(best.history))


def _offer_smaller(problem: Problem, x: Floats, best: Best) -> None:
    """Offer a smaller motion about the centre, if the motion breaks limits: little may be missing."""
    if problem.violation(x) <= BROKEN:
        return
    for share in _SHARES:
        found = problem.shrunk(x, share)
        if problem.violation(found) <= BROKEN:
            best.offer(found, problem.value(found))
            return


# -- several starts, each in a process of its own ----------------------------------------------------------------------


def solutions(
    problem: Problem,
    entry: ExcitationEntry,
    jobs: int,
    step: Callable[[str], None] = lambda _: None,
) -> list[Solution]:
    """Solutions from random starts: the same for the same seed, whatever the number of processes."""
    count, seed, iterations = entry.starts, entry.seed, entry.iterations

    def tell(k: int, solution: Solution) -> Solution:
        step(
            f"start {k + 1} of {count}: {solution.status}, criterion {solution.value:.5g}"
        )
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
    return constraint_generation(
        problem, problem.start(np.random.default_rng([seed, k])), iterations
    )


class _Processes:
    """Processes that solve, which can be ended together."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._running: set[subprocess.Popen[bytes]] = set()
        self._ended = False

    def solution(self, document: bytes, k: int) -> Solution:
        """Solution from start ``k``."""
        # the packages that this process found, wherever it found them
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        }
        command = [sys.executable, "-m", "echelon.excite.solve.solver", str(k)]
        with TemporaryFile() as errors:
            with self._lock:
                if self._ended:
                    raise EchelonError("the starts of the solver were ended")
                process = subprocess.Popen(
                    command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                    env=environment,
                )
                self._running.add(process)
            answer = b""
            with (
                suppress(BrokenPipeError),
                process,
            ):  # it ended early, which its exit code says
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
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # what a terminal sends to all is for the first process to answer
    problem, seed, iterations = pickle.load(sys.stdin.buffer)
    Thread(target=_end_with_parent, daemon=True).start()
    # libraries that print, in Python or not, must not spoil the answer
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    try:
        found: Solution | EchelonError = started(
            problem, seed, iterations, int(sys.argv[1])
        )
    except EchelonError as error:
        found = error
    out.write(pickle.dumps(found))
    out.flush()


def _end_with_parent() -> None:
    """Wait for the end of the input, which comes when the process that started this one ends, however it does."""
    while os.read(
        0, 1
    ):  # not through sys.stdin, which would be locked when the interpreter ends
        pass
    os._exit(1)


if __name__ == "__main__":
    from echelon.excite.solve import solver

    solver._work()  # under its own name, by which the process that asked knows the classes of the answer
