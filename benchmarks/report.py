"""The results as a Markdown table, as a plot, and as facts about the machine."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from machine import tables
from tabular import table
from targets import from_dict
from timing import Times

_PACKAGES = (
    "numpy",
    "scipy",
    "python-flint",
    "sympy",
    "llvmlite",
    "pin",
    "example-robot-data",
)
_PARTS = {
    "structure": "structure",
    "closed_forms": "closed forms",
    "certificate": "certificate",
    "numeric_svd": "Pinocchio + SVD",
}

_ABOUT_LINKAGES = """\
Mechanisms with loops, in memory like the robots.  Beside them a rank by floating point: the regressor in double
precision, stacked at random closed states near the assembly pose, both by Echelon's own routines, then NumPy's singular
values with their usual tolerance.  A chain of n is n four-bar linkages, the rocker of each being the crank of the next,
with one degree of freedom and 5n + 3 base parameters; closed forms are timed up to n = 2.  Wrong ranks by SVD are bold:
in longer chains small singular values drown in rounding, and where constraints are redundant (bennett, delta) the
rounding of closed states counts as rank."""


def environment(repeats: int) -> dict[str, Any]:
    """Machine, versions and date; no names of machines, people or folders."""
    return {
        "date": datetime.now(UTC).date().isoformat(),
        "machine": {
            "processor": _processor(),
            "cores": os.cpu_count(),
            "system": f"{platform.system()} {platform.machine()}",
        },
        "versions": {
            "python": platform.python_version(),
            "echelon": _echelon(),
            **_versions(),
        },
        "repeats": repeats,
    }


def _echelon() -> str:
    import echelon

    return str(echelon.__version__)


def _versions() -> dict[str, str]:
    found = {}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    names = [
        line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")
    ]
    return names[0] if names else platform.processor() or "unknown"


# -- Markdown ----------------------------------------------------------------------------------------------------------


def to_markdown(results: dict[str, Any]) -> str:
    """All tables of the sections that were run."""
    machine = results.get("machine", {})
    blocks = [
        _heading(results["environment"]),
        _targets(results.get("targets", []) + machine.get("targets", [])),
    ]
    if "robots" in results:
        blocks += [_start_up(results["start_up"]), _robots(results["robots"])]
        blocks += [_linkages(results["linkages"]), _chains(results)]
    if results.get("large"):
        blocks.append(_large(results["large"]))
    if machine:
        blocks.append(tables.to_markdown(machine))
    return "\n\n".join(blocks) + "\n"


def _heading(facts: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {text}" for name, text in facts["versions"].items())
    machine = facts["machine"]
    return (
        f"# Benchmarks\n\n{facts['date']}; {machine['processor']}, {machine['cores']} cores, {machine['system']}.\n"
        f"{versions}.\n\n"
        f"Times are minimum / median / maximum of at least {facts['repeats']} repeats, more for short ones.\n"
        "What is compared runs in turn, so that a slow spell of the machine hits all alike."
    )


def _targets(targets: list[dict[str, Any]]) -> str:
    return "## Targets\n\n" + table(
        ["target", "median", "limit", ""], [from_dict(t).cells() for t in targets]
    )


def _start_up(times: dict[str, dict[str, float]]) -> str:
    return "## Start-up, a fresh process\n\n" + table(
        ["process", "time"], [[k, Times(**t)] for k, t in times.items()]
    )


def _robots(rows: list[dict[str, Any]]) -> str:
    head = [
        "robot",
        "bodies",
        "symbols",
        "closed forms and certificate",
        "structure only",
        "Pinocchio + QR",
    ]
    head += ["Pinocchio + SVD", "closed forms : SVD", "structure : SVD"]
    cells = [
        [
            f"{r['robot']}, {r['variant']}",
            r["bodies"],
            r["symbols"],
            Times(**r["seconds"]["closed_forms"]),
            Times(**r["seconds"]["structure"]),
            None
            if r["rank_numeric_qr"] is None
            else Times(**r["seconds"]["numeric_qr"]),
            Times(**r["seconds"]["numeric_svd"]),
            f"{r['closed_forms_per_numeric_svd']:.2g}",
            f"{r['structure_per_numeric_svd']:.2g}",
        ]
        for r in rows
    ]
    ranks = [
        [
            f"{r['robot']}, {r['variant']}",
            r["parameters"],
            r["rank"],
            r["rank"] if r["literal_rank"] is None else r["literal_rank"],
            r["rank_numeric_qr"],
            r["rank_numeric_svd"],
        ]
        for r in rows
    ]
    names = [
        "robot",
        "standard parameters",
        "exact rank, intended",
        "exact rank, literal",
        "QR rank",
        "SVD rank",
    ]
    return (
        "## Robots\n\nFrom a robot in memory: Echelon's base parameters in closed form with their certificate, or the "
        "structure alone;\nbeside it a rank by floating point: Pinocchio's joint torque regressor stacked at random "
        "states, then QR with column\npivoting (SciPy) or singular values (NumPy).\n\n"
        + table(head, cells)
        + "\n\nWhat they report. The literal reading takes the decimals of a file at their word, as a numeric tool "
        "does.\n\n" + table(names, ranks)
    )


def _linkages(rows: list[dict[str, Any]]) -> str:
    head = [
        "linkage",
        "bodies",
        "standard parameters",
        "exact rank",
        "SVD rank",
        "closed forms and certificate",
    ]
    head += [
        "structure only",
        "closed states + SVD",
        "closed forms : SVD",
        "structure : SVD",
    ]
    return f"## Linkages\n\n{_ABOUT_LINKAGES}\n\n{table(head, [_linkage(row) for row in rows])}"


def _linkage(row: dict[str, Any]) -> list[Any]:
    times = {part: Times(**t) for part, t in row["seconds"].items()}
    ratios = {part: f"{ratio:.2g}" for part, ratio in row["per_numeric_svd"].items()}
    rank, by_svd = row["rank"], row["rank_numeric_svd"]
    return [
        row["linkage"],
        row["bodies"],
        row["parameters"],
        rank,
        by_svd if by_svd == rank else f"**{by_svd}**",
        *(times.get(part) for part in ("closed_forms", "structure", "numeric_svd")),
        *(ratios.get(part) for part in ("closed_forms", "structure")),
    ]


def _chains(results: dict[str, Any]) -> str:
    head = ["joints", "symbols", "rank", "SVD rank", "entries of B", *_PARTS.values()]
    cells = [
        [
            r["joints"],
            r["symbols"],
            r["rank"],
            r["rank_numeric_svd"],
            r["entries"],
            *(Times(**r["seconds"][part]) for part in _PARTS),
        ]
        for r in results["chains"]
    ]
    fitted = results["chain_exponents"]
    powers = ", ".join(
        f"{name} {fitted[part]}"
        for part, name in _PARTS.items()
        if fitted[part] is not None
    )
    note = (
        f"\n\nExponents of the growth with the number of joints, fitted from 10 joints on: {powers}."
        if powers
        else ""
    )
    return "## Serial chains with symbolic lengths\n\n" + table(head, cells) + note


# -- plot --------------------------------------------------------------------------------------------------------------


def _large(rows: list[dict[str, Any]]) -> str:
    head = ["mechanism", "symbols", "rank", "closed forms and certificate"]
    cells = [
        [r["mechanism"], r["symbols"], r["rank"], Times(**r["seconds"])] for r in rows
    ]
    return "## Large mechanisms\n\n" + table(head, cells)


def plot_chains(results: dict[str, Any], path: Path) -> None:
    """Cost against the number of joints."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    rows, fitted = results["chains"], results["chain_exponents"]
    joints = [row["joints"] for row in rows]
    figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for part, name in _PARTS.items():
        times = [row["seconds"][part] for row in rows]
        style = "k:" if part == "numeric_svd" else "-"
        power = "" if fitted[part] is None else f", joints^{fitted[part]}"
        (line,) = axes.plot(
            joints,
            [t["median"] for t in times],
            style,
            marker="o",
            markersize=4,
            label=name + power,
        )
        low, high = [t["minimum"] for t in times], [t["maximum"] for t in times]
        axes.fill_between(
            joints, low, high, color=line.get_color(), alpha=0.15, linewidth=0
        )
    axes.set(xscale="log", yscale="log", xlabel="revolute joints", ylabel="seconds")
    axes.set_title("Serial chains with symbolic lengths")
    axes.set_xticks(joints, [str(n) for n in joints])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120, metadata={"Software": None})
    plt.close(figure)
