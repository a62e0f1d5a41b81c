"""Every script in `examples` runs, says what its first lines promise, and takes seconds."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PRINTED = {
    "01_derive.py": "BaseModel(panda: 43 base parameters of 70)",
    "02_geometry_and_gravity.py": "gravity none: 4 base parameters",
    "03_regressor.py": "X = X̄ B: True",
    "04_values_and_lift.py": "same base parameters: True",
    "05_save_and_verify.py": "altered: unit, expression or values of ZZ1 contradict its terms",
    "06_audit.py": "M2 has the coefficient l1 = 0.3 instead of l1^2 = 0.09",
    "07_sensors.py": "sufficient: base",
    "08_generate_code.py": "generated code agrees: True",
    "09_linear_model.py": "c + d",
    "10_identify.py": "The model predicts every output well",
    "11_experiments.py": "the wall alone shows all: 45",
    "12_elastic_joint.py": "stiffness within four standard deviations: True",
    "13_compare.py": "gripper 8 g heavier: different, 23 of 36 base parameters",
    "14_adaptive_control.py": "converged: True",
}
"""A line that each script prints."""


def test_all_scripts_are_listed() -> None:
    assert {path.name for path in (ROOT / "examples").glob("*.py")} == set(PRINTED)


@pytest.mark.parametrize("name", PRINTED)
def test_script(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")
    said = capsys.readouterr()
    assert said.err == ""
    assert PRINTED[name] in said.out
    assert not list(tmp_path.iterdir())
