"""What machine code must reach."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from machine.facts import has_avx512
from machine.throughput import ALL, ONE
from targets import Target

# (robot, ratio, threads, limit); half where vectors are narrower than those of AVX-512
_THROUGHPUT = (
    ("ur10", "pinocchio : dense", ONE, 20),
    ("ur10", "pinocchio : dense", ALL, 8),
    ("ur10", "figaroh : dense", ONE, 80),
    ("panda", "pinocchio : dense", ONE, 12),
    ("talos", "pinocchio : dense", ONE, 12),
    ("talos", "pinocchio : entries", ONE, 20),
)
_ABOUT = {
    "pinocchio : dense": "dense base W from Python : Pinocchio C++",
    "figaroh : dense": "dense base W from Python : FIGAROH",
    "pinocchio : entries": "entries of base W from Python : Pinocchio C++",
}
_CALLS = 5
_OPERATIONS = {"rx90": (229, 247), "puma560": (241, 259), "ur10": (246, 262)}
_TO_C = 1.0
_FIRST_USES = {"panda": {"cold": 0.2, "cached": 0.02}, "talos": {"cold": 5.0}}
_LEAST_SQUARES = {False: 6, True: 8}  # several threads
_MEGABYTES = 100
_DIFFERENCE = 1e-12
_BETTER = 10


def judged(found: dict[str, Any]) -> list[dict[str, Any]]:
    """Targets that some measurements can judge, by median."""
    wanted = (
        _regressors,
        _dynamics,
        _compilation,
        _least_squares,
        _bad_data,
        _accuracy,
    )
    return [target.as_dict() for part in wanted for target in part(found)]


def _ratio(text: str, median: float, limit: float) -> Target:
    return Target(text, median, limit, "×", at_least=True)


def _regressors(found: dict[str, Any]) -> Iterator[Target]:
    share = 1.0 if has_avx512() else 0.5
    rows = {row["name"]: row for row in found.get("regressors", ())}
    for name, ratio, threads, limit in _THROUGHPUT:
        spread = rows.get(name, {"ratios": {}})["ratios"].get(f"{ratio}, {threads}")
        if spread:
            yield _ratio(
                f"{rows[name]['robot']}, {_ABOUT[ratio]}, {threads}",
                spread["median"],
                share * limit,
            )


def _dynamics(found: dict[str, Any]) -> Iterator[Target]:
    for row in found.get("calls", ()):
        if row["ratio"]:
            yield _ratio(
                f"{row['robot']}, a call of generated C : Pinocchio C++ RNEA",
                row["ratio"]["median"],
                _CALLS,
            )
    for row in found.get("operations", ()):
        for kind, limit in zip(
            ("additions", "multiplications"), _OPERATIONS[row["robot"]], strict=True
        ):
            yield Target(
                f"{row['label']}, {kind} of inverse dynamics", row[kind], limit, ""
            )


def _compilation(found: dict[str, Any]) -> Iterator[Target]:
    for row in found.get("to_compiled_c", ()):
        if "seconds" in row:
            yield Target(
                f"{row['robot']} from its file to compiled C",
                row["seconds"]["all"]["median"],
                _TO_C,
            )
    about = {"cold": "compiled", "cached": "from the cache in a running process"}
    for row in found.get("first_uses", ()):
        for state, limit in _FIRST_USES[row["name"]].items():
            yield Target(
                f"{row['what']}, {about[state]}", row["seconds"][state]["median"], limit
            )


def _least_squares(found: dict[str, Any]) -> Iterator[Target]:
    share = 1.0 if has_avx512() else 0.5
    for row in found.get("least_squares", ()):
        threads = row["threads"]
        name = (
            f"UR10, least squares, {threads} {'threads' if threads > 1 else 'thread'}"
        )
        yield _ratio(
            f"{name} : NumPy lstsq",
            row["ratio"]["median"],
            share * _LEAST_SQUARES[threads > 1],
        )
        if row["megabytes"] is not None:
            yield Target(
                f"{name}, peak of extra memory", row["megabytes"], _MEGABYTES, "MB"
            )
        yield Target(
            f"{name}, difference from lstsq", row["difference"], _DIFFERENCE, ""
        )


def _bad_data(found: dict[str, Any]) -> Iterator[Target]:
    if rows := found.get("bad_data"):
        errors = rows[-1]["errors"]
        gain = errors["normal equations"] / errors["fused QR"]
        yield _ratio(
            "UR10, bad data, error of the normal equations : fused QR", gain, _BETTER
        )


def _accuracy(found: dict[str, Any]) -> Iterator[Target]:
    for row in found.get("accuracy", ()):
        worst = max(row[what] for what in ("base", "standard", "predict"))
        yield Target(
            f"{row['robot']}, difference from Pinocchio", worst, _DIFFERENCE, ""
        )
        yield Target(
            f"{row['robot']}, results that change with threads",
            int(not row["same on all threads"]),
            0,
            "",
        )
