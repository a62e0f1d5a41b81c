"""Install wheels and source distributions into fresh environments and use them.

    python packaging/smoke.py dist/*.whl dist/*.tar.gz          what works without extras, and what is said
    python packaging/smoke.py --extras fast,identify dist/*.whl  the same with one extra after another ("all")
    python packaging/smoke.py --write docs/installation.md ...   and how much each installs, into that page

Run it with the interpreter to try; nothing of the checkout but examples is used.
"""

import argparse
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
ROBOT = str(EXAMPLES / "double_pendulum.yaml")
LOG = EXAMPLES / "data/panda_30hz/panda_exciting.parquet"
MOST = 200
"""Megabytes that the core may take."""

XACRO = """<robot name="a" xmlns:xacro="http://ros.org/wiki/xacro">
<xacro:macro name="l"><link name="b"/></xacro:macro><xacro:l/>
</robot>"""
USES: dict[str, list[str]] = {
    "symbolic": ["derive", ROBOT, "--regressor", "latex"],
    "mjcf": ["derive", str(EXAMPLES / "two_link.xml")],
    "robots": ["derive", "arm.urdf.xacro"],
    "identify": [
        "identify",
        str(EXAMPLES / "logs/panda_30hz.yaml"),
        str(LOG),
        "-o",
        "model",
    ],
    "excite": ["excite", ROBOT, "--duration", "6", "--starts", "1", "-o", "motion"],
}
"""A command that needs each extra."""

MISSING = re.compile(
    r'echelon: this needs the package \'\w+\': install it with  pip install "echelon-robotics\[(\w+)\]"\n'
)
COMPILED = """
import echelon as ec, numpy as np
base = ec.base_parameters(ec.load("{robot}"))
q = np.ones((3, 2))
assert np.isfinite(base.predict(q, q, q, np.ones(base.rank))).all()
"""


METADATA = """
from importlib.metadata import metadata
found = metadata("echelon-robotics")
assert found["Description-Content-Type"] == "text/markdown", found.items()
assert len(found.get_payload()) > 1000, "the README is missing"
"""


class Environment:
    """A fresh environment with the package in it."""

    def __init__(self, folder: Path, file: Path, extra: str) -> None:
        venv.create(folder / "env", with_pip=True)
        self.folder, self.extra = folder, extra
        self.scripts = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
        self._sound(
            "python",
            "-m",
            "pip",
            "install",
            "--quiet",
            f"{file}[{extra}]" if extra else str(file),
        )

    def run(self, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = [self.scripts / program, *arguments]
        return subprocess.run(
            command, cwd=self.folder, capture_output=True, encoding="utf-8", check=False
        )

    def _sound(self, *command: str) -> str:
        done = self.run(*command)
        if done.returncode:
            raise SystemExit(
                f"{' '.join(command)}: exit code {done.returncode}\n{done.stdout}{done.stderr}"
            )
        return done.stdout

    def megabytes(self) -> int:
        """What the package and all that it needs take."""
        own = re.compile(r"pip|setuptools|pkg_resources|_distutils_hack|wheel")
        (packages,) = (self.folder / "env").glob("[Ll]ib/**/site-packages")
        files = (
            f
            for top in packages.iterdir()
            if not own.match(top.name)
            for f in [top, *top.rglob("*")]
        )
        return round(sum(f.stat().st_size for f in files if f.is_file()) / 1e6)

    def check_core(self) -> None:
        """What works without extras."""
        self._sound("python", "-c", METADATA)
        self._sound(
            "echelon",
            "derive",
            str(EXAMPLES / "panda.yaml"),
            "--json",
            "-o",
            "panda.json",
        )
        rank = json.loads((self.folder / "panda.json").read_text(encoding="utf-8"))[
            "rank"
        ]
        if (
            rank != 43
        ):  # Gautier and Khalil's count for seven revolute joints of this kind
            raise SystemExit(f"{rank} base parameters of the Panda, expected 43")
        self._sound("python", "-m", "echelon", "verify", "panda.json")
        self._sound(
            "echelon",
            "derive",
            str(EXAMPLES / "loops/four_bar.yaml"),
            "--format",
            "latex",
        )
        text = self._sound("echelon", "derive", ROBOT)
        named = re.search(r"\((\S+assumptions\.(?:md|html))\)", text)
        if not named or not ("://" in named[1] or Path(named[1]).is_file()):
            raise SystemExit(f"the page that 'derive' names does not open:\n{text}")
        self._sound("echelon", "sensors", ROBOT)
        self._sound("echelon", "generate", "panda.json", "--target", "c", "-o", "code")
        if not any((self.folder / "code").iterdir()):
            raise SystemExit("no code was generated")
        self._sound("python", "-c", COMPILED.replace("{robot}", Path(ROBOT).as_posix()))

    def check_extras(self) -> None:
        """The extra that is there does its job; the others are named by one line, or happen to be there as well."""
        (self.folder / "arm.urdf.xacro").write_text(XACRO, encoding="utf-8")
        for extra, command in USES.items():
            done = self.run("echelon", *command)
            named = MISSING.fullmatch(done.stderr)
            if extra == self.extra:
                fine = done.returncode == 0
            elif named:
                fine = named[1] == extra if not self.extra else named[1] != self.extra
            else:
                fine = done.returncode == 0 and bool(self.extra)
            if not fine:
                raise SystemExit(
                    f"with [{self.extra}], echelon {' '.join(command)}: {done.returncode}\n{done.stderr}"
                )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--extras", default="", metavar="LIST")
    parser.add_argument("--write", type=Path, metavar="PAGE")
    asked = parser.parse_args()
    sizes: dict[str, int] = {}
    for file in asked.files:
        for extra in [
            "",
            *(
                ("fast", *USES)
                if asked.extras == "all"
                else filter(None, asked.extras.split(","))
            ),
        ]:
            with tempfile.TemporaryDirectory() as folder:
                there = Environment(Path(folder), file.resolve(), extra)
                sizes[extra] = there.megabytes()
                there.check_core()
                there.check_extras()
            print(
                f"{file.name}[{extra}]: works with Python {sys.version.split()[0]}, {sizes[extra]} MB",
                flush=True,
            )
        if sizes[""] > MOST:
            raise SystemExit(f"the core takes {sizes['']} MB, more than {MOST}")
    if asked.write:
        write_sizes(asked.write, sizes)


def write_sizes(page: Path, sizes: dict[str, int]) -> None:
    """Put what was measured between the marks of the page; extras that were not tried keep their rows."""
    head, begin, rest = page.read_text(encoding="utf-8").partition("<!-- sizes -->\n")
    table, end, tail = rest.partition("<!-- /sizes -->")
    known = (
        dict(re.findall(r"\| `echelon-robotics(?:\[(\w+)\])?` \| (\d+) MB \|", table))
        | sizes
    )
    rows = [
        f"| `echelon-robotics{f'[{extra}]' if extra else ''}` | {size} MB |"
        for extra, size in known.items()
    ]
    system = (
        f"{platform.system()}, Python {sys.version_info.major}.{sys.version_info.minor}"
    )
    text = "\n".join([f"| {system} | installed |", "|---|--:|", *rows, ""])
    page.write_text(head + begin + text + end + tail, encoding="utf-8")


if __name__ == "__main__":
    main()
