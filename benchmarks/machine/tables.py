"""The measurements of machine code as Markdown tables."""

from __future__ import annotations

from typing import Any

from machine.throughput import JOBS
from ratios import Spread, short
from tabular import table
from timing import Times

_ABOUT = """\
{date}; {cores} cores, so "all threads" are {cores}; {rounds} rounds.  Processor for LLVM: {cpu} ({sets}), {lanes}
samples in a vector; {llvm}; {compilers}; {tools}.

Everything here is called from Python, except what is said to be C or C++.  Pinocchio in C++ is compiled from its
headers with `{flags}` (with
Eigen's own vectors it is slower), and its loops are timed in C++; a thread has its own share of the samples and its
own `Data`.  Numbers are minimum / median / maximum over the rounds; all jobs run in turn, and a ratio is that of two
jobs of one round."""

_ABOUT_THROUGHPUT = """\
Nanoseconds per sample.  States are random, the same for all, and so many that no cache holds W.  Arrays are written
once before they are measured, except where a fresh one is meant.  Pinocchio and FIGAROH fill W in all standard
columns, as they cannot do otherwise; "dense standard W" compares like with like.  FIGAROH is timed on one sample
in 20.  What writing costs is measured by filling an array of the same size past the caches with a number, in C++;
some processors write lines of zeros faster, and most of the humanoid's W is zero."""

_ABOUT_DYNAMICS = """\
Nanoseconds per call for one state after another, in C and in C++; the states fit into the cache.  Ours takes base
parameters as an argument, and is compiled with `{flags}`."""

_ABOUT_OPERATIONS = """\
Additions (with subtractions) and multiplications of inverse dynamics with base parameters and symbolic lengths; what
depends on parameters and lengths alone is done once and not counted.  Beside them, counts that others published."""

_ABOUT_LEAST_SQUARES = """\
From states and torques to base parameters: fused QR, in which W never exists, beside `numpy.linalg.lstsq` on a W that
is ready.  Extra memory is the growth of the process's peak in a first run, compilation included.  The difference is
that of the solutions, scaled by the norms of the columns."""

_ABOUT_BAD = """\
Motions become small around one pose, so that W becomes ill-conditioned.  Errors are relative to the solution for the
same numbers in 400-bit arithmetic; all methods work on scaled columns or do not depend on their scale."""

_ABOUT_ACCURACY = """\
Largest difference of an entry from Pinocchio's, relative to the largest of its column, over random states; both read
the decimals of the file as they are."""


def to_markdown(found: dict[str, Any]) -> str:
    """All tables of the parts that were run."""
    makers = {
        "regressors": _regressors,
        "calls": _calls,
        "operations": _operations,
        "to_compiled_c": _to_compiled_c,
        "first_uses": _first_uses,
        "least_squares": _least_squares,
        "bad_data": _bad_data,
        "accuracy": _accuracy,
    }
    blocks = [f"## Machine code\n\n{_facts(found['facts'])}"]
    blocks += [maker(found[part]) for part, maker in makers.items() if part in found]
    return "\n\n".join(blocks)


def _facts(facts: dict[str, Any]) -> str:
    from anchors.pinocchio_cpp import FLAGS

    return _ABOUT.format(
        flags=" ".join(FLAGS),
        **{
            name: facts[name]
            for name in ("date", "cores", "rounds", "cpu", "lanes", "llvm")
        },
        sets=", ".join(facts["instruction_sets"]),
        compilers="; ".join(dict.fromkeys(facts["compilers"].values())),
        tools=", ".join(
            f"{name} {version}" for name, version in facts["tools"].items()
        ),
    )


def _spread(stored: dict[str, float] | None) -> Spread | None:
    return None if stored is None else Spread(**stored)


# -- regressors --------------------------------------------------------------------------------------------------------


def _regressors(rows: list[dict[str, Any]]) -> str:
    head = ["ns per sample", *(row["robot"] for row in rows)]
    jobs = list(dict.fromkeys(job for row in rows for job in row["ns"]))
    names = {
        job: _job(job)
        for job in sorted(jobs, key=lambda job: list(JOBS).index(job.split(",")[0]))
    }
    times = [
        [text, *(_spread(row["ns"].get(job)) for row in rows)]
        for job, text in names.items()
    ]
    pairs = list(dict.fromkeys(pair for row in rows for pair in row["ratios"]))
    ratios = [
        [_pair(pair), *(_spread(row["ratios"].get(pair)) for row in rows)]
        for pair in pairs
    ]
    sizes = ["samples; dense base W of one sample; its non-zeros; dense base W"]
    sizes += [
        f"{r['samples']}; {r['shape'][0]} × {r['shape'][1]}; {r['entries']}; {r['megabytes']} MB"
        for r in rows
    ]
    skipped = list(dict.fromkeys(text for row in rows for text in row["skipped"]))
    notes = "".join(f"\n\nLeft out: {text}." for text in skipped)
    return (
        f"### Regressors of many samples\n\n{_ABOUT_THROUGHPUT}{notes}\n\n{table(head, [sizes, *times])}\n\n"
        f"{table(['times as fast', *(row['robot'] for row in rows)], ratios)}"
    )


def _job(job: str) -> str:
    name, threads = job.split(", ")
    return f"{JOBS[name]}, {threads}"


def _pair(pair: str) -> str:
    names, threads = pair.rsplit(", ", 1)
    slower, faster = names.split(" : ")
    return f"{JOBS[faster]} : {JOBS[slower]}, {threads}"


# -- dynamics and compilation ------------------------------------------------------------------------------------------


def _calls(rows: list[dict[str, Any]]) -> str:
    from anchors.generated_c import FLAGS

    cells = [
        [
            r["robot"],
            _spread(r["ns"].get("generated")),
            _spread(r["ns"].get("rnea")),
            _spread(r["ratio"]),
        ]
        for r in rows
    ]
    head = ["robot", "generated C", "Pinocchio C++ RNEA", "times as fast"]
    notes = "".join(
        f"\n\nLeft out: {text}."
        for text in dict.fromkeys(t for row in rows for t in row["skipped"])
    )
    about = _ABOUT_DYNAMICS.format(flags=" ".join(FLAGS))
    return f"### Inverse dynamics, one call\n\n{about}{notes}\n\n{table(head, cells)}"


def _operations(rows: list[dict[str, Any]]) -> str:
    tools = list(dict.fromkeys(tool for row in rows for tool in row["published"]))
    cells = []
    for row in rows:
        published = (row["published"].get(tool) for tool in tools)
        ours = f"{row['additions']} / {row['multiplications']}"
        cells.append(
            [
                row["label"],
                ours,
                *(pair and f"{pair[0]} / {pair[1]}" for pair in published),
            ]
        )
    return f"### Operations of inverse dynamics\n\n{_ABOUT_OPERATIONS}\n\n{table(['robot', 'Echelon', *tools], cells)}"


def _to_compiled_c(rows: list[dict[str, Any]]) -> str:
    title = "### From a file to compiled inverse dynamics in C"
    if skipped := [row["skipped"] for row in rows if "skipped" in row]:
        return f"{title}\n\nLeft out: {skipped[0]}."
    parts = list(rows[0]["seconds"])
    cells = [
        [row["robot"], *(Times(**row["seconds"][part]) for part in parts)]
        for row in rows
    ]
    return f"{title}\n\n{table(['robot', *parts], cells)}"


def _first_uses(rows: list[dict[str, Any]]) -> str:
    head = [
        "first use",
        "compiled, a fresh process",
        "from the cache, a running process",
    ]
    cells = [
        [r["what"], *(Times(**r["seconds"][state]) for state in ("cold", "cached"))]
        for r in rows
    ]
    return f"### Until a first regressor is there, from base parameters in memory\n\n{table(head, cells)}"


# -- least squares and accuracy ----------------------------------------------------------------------------------------


def _least_squares(rows: list[dict[str, Any]]) -> str:
    head = [
        "threads",
        "samples",
        "size of W",
        "fused QR",
        "fused normal equations",
        "NumPy lstsq",
    ]
    head += ["times as fast", "extra memory", "difference"]
    cells = [
        [
            r["threads"],
            r["samples"],
            f"{r['W_gigabytes']} GB",
            *(Times(**r["seconds"][part]) for part in ("fused", "gram", "lstsq")),
            _spread(r["ratio"]),
            None if r["megabytes"] is None else f"{short(r['megabytes'])} MB",
            short(r["difference"]),
        ]
        for r in rows
    ]
    return f"### Least squares, UR10\n\n{_ABOUT_LEAST_SQUARES}\n\n{table(head, cells)}"


def _bad_data(rows: list[dict[str, Any]]) -> str:
    methods = list(rows[0]["errors"])
    cells = [
        [
            short(r["amplitude"]),
            short(r["condition"]),
            *(short(r["errors"][name]) for name in methods),
        ]
        for r in rows
    ]
    return f"### Bad data, UR10\n\n{_ABOUT_BAD}\n\n{table(['amplitude', 'condition of W', *methods], cells)}"


def _accuracy(rows: list[dict[str, Any]]) -> str:
    head = [
        "robot",
        "base W",
        "standard W",
        "outputs",
        "same on one thread and several",
    ]
    cells = [
        [
            r["robot"],
            *(short(r[what]) for what in ("base", "standard", "predict")),
            "yes" if r["same on all threads"] else "**no**",
        ]
        for r in rows
    ]
    return f"### Accuracy\n\n{_ABOUT_ACCURACY}\n\n{table(head, cells)}"
