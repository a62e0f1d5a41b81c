"""Install a wheel or a source distribution into a fresh environment and derive a robot with it.

    python packaging/smoke.py dist/echelon-0.1.0-py3-none-any.whl [more files]

Run it with the interpreter to try; nothing of the checkout is on its path.
"""

import json
import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def main(files: list[str]) -> None:
    for file in map(Path, files):
        with tempfile.TemporaryDirectory() as folder:
            smoke(file.resolve(), Path(folder))
        print(f"{file.name}: works with Python {sys.version.split()[0]}")


def smoke(file: Path, folder: Path) -> None:
    venv.create(folder / "env", with_pip=True)
    scripts = folder / "env" / ("Scripts" if os.name == "nt" else "bin")

    def run(program: str, *arguments: str) -> str:
        return subprocess.run(
            [scripts / program, *arguments], cwd=folder, check=True, stdout=subprocess.PIPE, encoding="utf-8"
        ).stdout

    run("python", "-m", "pip", "install", "--quiet", str(file))
    robot = str(EXAMPLES / "panda.yaml")
    run("echelon", "derive", robot, "--json", "-o", "panda.json")
    rank = json.loads((folder / "panda.json").read_text(encoding="utf-8"))["rank"]
    if rank != 43:  # Gautier and Khalil's count for seven revolute joints of this kind
        raise SystemExit(f"{file.name}: {rank} base parameters of the Panda, expected 43")
    run("echelon", "verify", "panda.json")
    run("echelon", "generate", "panda.json", "--target", "c", "-o", "code")
    if not any((folder / "code").iterdir()):
        raise SystemExit(f"{file.name}: no code was generated")


if __name__ == "__main__":
    main(sys.argv[1:] or sys.exit(__doc__))
