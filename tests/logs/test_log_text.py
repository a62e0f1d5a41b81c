"""Text as logs: separators, headings, comments, gaps and numbers, with pyarrow and without."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from echelon.identification.logs.files.csv_file import CsvFile
from echelon.identification.logs.files.open_log import read_table
from echelon.shared.errors import InputError
from support.log_tables import joined, same, text


@pytest.fixture(params=["pyarrow", "numpy"])
def parser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Text is parsed with pyarrow, and as if it were not installed."""
    if request.param == "numpy":
        monkeypatch.setitem(sys.modules, "pyarrow", None)
    return str(request.param)


@pytest.mark.usefixtures("parser")
@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("t,q\n0,1.5\n1,-2e-3\n", {"t": [0, 1], "q": [1.5, -0.002]}),
        ("0,1.5\n1,2\n", {"0": [0, 1], "1": [1.5, 2]}),
        ("0,1.5\n1,2", {"0": [0, 1], "1": [1.5, 2]}),
        ("t;q\r\n0,25;1,5\r\n1;2\r\n", {"t": [0.25, 1], "q": [1.5, 2]}),
        ("t;q\n0.25;1.5\n", {"t": [0.25], "q": [1.5]}),
        ("t\tq\n0,5\t1\n", {"t": [0.5], "q": [1]}),
        ("t q\n  0   1.5\n 1\t2 \n", {"t": [0, 1], "q": [1.5, 2]}),
        ("1,5 2,5\n3,5 4\n", {"0": [1.5, 3.5], "1": [2.5, 4]}),
        ("\ufefft,q\n0,1\n", {"t": [0], "q": [1]}),
        ("\ufeff0,1\n2,3\n", {"0": [0, 2], "1": [1, 3]}),
        ('"time, s","joint ""1"""\n0,"1.5"\n', {"time, s": [0], 'joint "1"': [1.5]}),
        ('time "joint 1"\n0 1.5\n', {"time": [0], "joint 1": [1.5]}),
        ("# a log\n#\n# t q\n0 1\n", {"t": [0], "q": [1]}),
        ("# recorded today by me\n0 1\n", {"0": [0], "1": [1]}),
        ("# robot\nt,q\n0,1\n# pause\n\n1,2\n", {"t": [0, 1], "q": [1, 2]}),
        (
            "t,q\n0,\n1,nan\n2,NA\n,3\n",
            {"t": [0, 1, 2, np.nan], "q": [np.nan, np.nan, np.nan, 3]},
        ),
        ("t,on\n0,true\n1,False\n", {"t": [0, 1], "on": [1, 0]}),
        (
            "t,q\n0,inf\n1,-Infinity\n+2,+.5\n",
            {"t": [0, 1, 2], "q": [np.inf, -np.inf, 0.5]},
        ),
        ("t,,q\n0,1,2\n", {"t": [0], "1": [1], "q": [2]}),
        ("q\n1.5\n\n2.5\n", {"q": [1.5, 2.5]}),
        ("1.5\n2.5\n", {"0": [1.5, 2.5]}),
        (
            "t,q\n2026-03-01T12:00:00.25Z,1\n2026-03-01T14:00:01.5+02:00,2\n",
            {"t": [0.25, 1.5], "q": [1, 2]},
        ),
        (
            "t;q\n2026-02-28 23:59:59,5;1\n2026-03-01 00:00:00,25;2\n",
            {"t": [0.5, 1.25], "q": [1, 2]},
        ),
        ("9:59:59,1\n10:00:00.5,2\n", {"0": [-1, 0.5], "1": [1, 2]}),
        ("# t q\n2026-02-28T00:00:01 1\n", {"t": [0], "q": [1]}),
        (
            "t,q\n31.01.2026 23:59:59.5,1\n1.2.2026 00:00:00,2\n",
            {"t": [0.5, 1], "q": [1, 2]},
        ),
        ("t|q\n0|1\n", {"t": [0], "q": [1]}),
        ("% by hand\n% t,q\n0,1\n// pause\n1,2\n", {"t": [0, 1], "q": [1, 2]}),
        ("%time,q\n0,1\n", {"%time": [0], "q": [1]}),
        (
            "robot: 7\nrate: 50 Hz\n\nt,q\n0,1\n1,2\n2,3\n3,4\n",
            {"t": range(4), "q": range(1, 5)},
        ),
        ("t,q,\n0,1,\n", {"t": [0], "q": [1], "2": [np.nan]}),
        ("t,q\n0,1,\n1,2,\n", {"t": [0, 1], "q": [1, 2], "2": [np.nan, np.nan]}),
        ("t q\n1 0 5\n2 1 6\n", {"0": [1, 2], "t": [0, 1], "q": [5, 6]}),
        ("t,q,q\n0,1,2\n", {"t": [0], "q[0]": [1], "q[1]": [2]}),
        (
            ",q,f\n,a,a\nt,,\n0,1,2\n1,2,3\n2,3,4\n",
            {"t": range(3), "q/a": [1, 2, 3], "f/a": [2, 3, 4]},
        ),
        ("t,q\n0,-\n1,#N/A\n", {"t": [0, 1], "q": [np.nan, np.nan]}),
    ],
)
def test_layouts_of_text(
    content: str, expected: dict[str, list[float]], tmp_path: Path
) -> None:
    log = CsvFile(text(tmp_path, content))
    assert log.names == tuple(expected)
    same(joined(log), expected)
    same(joined(log, rows=1), expected)


@pytest.mark.usefixtures("parser")
@pytest.mark.parametrize("rows", [1 << 17, 50])
def test_few_rows_that_cannot_be_read_are_left_out_and_named(
    rows: int, tmp_path: Path
) -> None:
    lines = ["t,q", *(f"{k},{k / 2}" for k in range(300))]
    lines[201:203] = ["garbage", "200,x", "201,100"]
    tables = list(CsvFile(text(tmp_path, "\n".join([*lines, "300"]))).tables(rows=rows))
    found = np.concatenate([table.columns["t"] for table in tables])
    np.testing.assert_array_equal(found, [k for k in range(300) if k not in (200,)])
    assert [row for table in tables for row in table.left_out] == [
        "line 202: has 1 cell where the file has 2 columns",
        "line 203, column 'q': 'x' is not a number",
        "line 303: has 1 cell where the file has 2 columns",
    ]
    many = [line if k % 50 else "garbage" for k, line in enumerate(lines[1:])]
    with pytest.raises(InputError, match="line 2: has 1 cell"):
        list(CsvFile(text(tmp_path, "\n".join([*lines[:1], *many]))).tables())


@pytest.mark.usefixtures("parser")
@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("t,q\n0,1\n1,AUTO\n", r"line 3, column 'q': 'AUTO' is not a number"),
        (
            "t,q\n03/01/2026 12:00:00,1\n",
            r"column 't': '03/01/2026 12:00:00' is not a number; write times as numbers or as 2026-05-01T12:30:00.25",
        ),
        ("t,q\n0,1_000\n", r"line 2, column 'q': '1_000' is not a number"),
        ("t,q\n0,0x10\n", r"line 2, column 'q': '0x10' is not a number"),
        ("t;q\n0;1.234,5\n", r"line 2, column 'q': '1.234,5' is not a number"),
        ("# log\nt,q\n0,1\n\n2\n", r"line 5: has 1 cell where the file has 2 columns"),
        ("t,q\n0,1\n0,1,\n", r"line 3: has 3 cells where the file has 2 columns"),
        ("t q\n0 1\n0 1 2\n", r"line 3: has 3 cells where the file has 2 columns"),
        ("t,q,t\n0,1,2\n", r"line 1, column 't': columns 0 and 2 have the same name"),
        ("t,q\n", "holds the names of columns but no numbers"),
        ("# nothing\n\n", "holds no numbers: all lines are blank or comments"),
        (b"t,q\n0,1\n\0\0", "is not text"),
        ("t,q\r0,1\r", "carriage returns inside lines"),
        ("1" * (2 << 20), "has more than 1,048,576 bytes in a line"),
    ],
)
def test_text_that_is_no_log(
    content: str | bytes, problem: str, tmp_path: Path
) -> None:
    path = text(tmp_path, content)
    with pytest.raises(InputError, match=problem) as caught:
        read_table(path)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.usefixtures("parser")
@pytest.mark.parametrize("units", ["ms,deg,", "[ms],[deg],-"])
def test_a_line_of_units_below_the_names(units: str, tmp_path: Path) -> None:
    log = CsvFile(
        text(tmp_path, f"made by a program\nt,q,n\n{units}\n0,1,2\n1,2,3\n2,3,4\n")
    )
    assert log.units == {"t": "ms", "q": "deg", "n": ""}
    same(joined(log), {"t": [0, 1, 2], "q": [1, 2, 3], "n": [2, 3, 4]})


@pytest.mark.usefixtures("parser")
def test_a_row_of_ones_is_no_line_of_units(tmp_path: Path) -> None:
    same(
        read_table(text(tmp_path, "t,q\n1,1\n2,1\n")).columns,
        {"t": [1, 2], "q": [1, 1]},
    )


@pytest.mark.usefixtures("parser")
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings_of_windows(encoding: str, tmp_path: Path) -> None:
    path = text(tmp_path, "t,Gelenk °\n0,1\n1,2\n".encode(encoding))
    same(read_table(path).columns, {"t": np.arange(2), "Gelenk °": np.arange(1, 3)})


@pytest.mark.usefixtures("parser")
def test_text_that_nobody_asks_for_may_stand_beside_numbers(tmp_path: Path) -> None:
    path = text(
        tmp_path, "t,mode,q\n" + "".join(f"{k},AUTO,{k / 8}\n" for k in range(100))
    )
    same(
        read_table(path, ["q", "t"]).columns,
        {"q": np.arange(100) / 8, "t": np.arange(100)},
    )
    with pytest.raises(
        InputError, match=r"line 2, column 'mode': 'AUTO' is not a number"
    ):
        read_table(path)
    path = text(
        tmp_path,
        "t,names,note,q\n"
        + "".join(f"{k},\"['a', 'b']\",,\"({k}, 2)\"\n" for k in range(9)),
    )
    same(
        read_table(path, ["t", "q[0]", "q[1]"]).columns,
        {"t": np.arange(9), "q[0]": np.arange(9), "q[1]": np.full(9, 2)},
    )


@pytest.mark.usefixtures("parser")
def test_lines_are_counted_over_pieces(tmp_path: Path) -> None:
    path = text(
        tmp_path, "# log\nt,q\n" + "0,1\n" * 50 + "# pause\n" + "0,1\n" * 20 + "0,x\n"
    )
    with pytest.raises(InputError, match=r"line 74, column 'q': 'x' is not a number"):
        list(CsvFile(path).tables(rows=7))


NUMBERS = st.floats(allow_nan=True, allow_infinity=True) | st.integers(
    -(10**30), 10**30
)
STYLES = {
    "repr": repr,
    "short": lambda value: f"{value:.3g}",
    "exponent": lambda value: f"{value:+.17E}",
}


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=st.lists(
        st.tuples(NUMBERS, NUMBERS, st.none() | NUMBERS), min_size=1, max_size=12
    ),
    delimiter=st.sampled_from([",", ";", "\t", ", "]),
    style=st.sampled_from(sorted(STYLES)),
    newline=st.sampled_from(["\n", "\r\n"]),
)
def test_numbers_are_read_as_python_reads_them(
    parser: str,
    rows: list[tuple[Any, ...]],
    delimiter: str,
    style: str,
    newline: str,
    tmp_path: Path,
) -> None:
    cells = [
        ["" if value is None else STYLES[style](value) for value in row] for row in rows
    ]
    if delimiter in (";", "\t"):
        cells = [[cell.replace(".", ",") for cell in row] for row in cells]
    content = (
        newline.join(delimiter.join(row) for row in [["a", "b", "c"], *cells]) + newline
    )
    found = read_table(text(tmp_path, content, f"{parser}.csv")).columns
    expected = np.array(
        [[float(cell.replace(",", ".") or "nan") for cell in row] for row in cells]
    )
    np.testing.assert_array_equal(
        np.column_stack([found["a"], found["b"], found["c"]]), expected
    )
