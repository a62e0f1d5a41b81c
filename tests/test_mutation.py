"""The list of faults of `make mutate` is up to date."""

from __future__ import annotations

import pytest

from mutation.fault import ROOT, Fault
from mutation.faults import FAULTS


def test_every_package_has_faults() -> None:
    assert len(set(FAULTS)) == len(FAULTS) >= 200
    packages = {
        file.parent.name for file in (ROOT / "src" / "echelon").glob("*/__init__.py")
    }
    assert {fault.file.split("/")[0] for fault in FAULTS} == packages | {
        ".."
    }  # the site's zoo


@pytest.mark.parametrize(
    "fault", FAULTS, ids=lambda fault: f"{fault.file}: {fault.breaks}"
)
def test_the_fault_applies_to_the_source(fault: Fault) -> None:
    """The changed code occurs exactly once, the file still compiles, and its tests exist."""
    changed = fault.applied((ROOT / fault.path).read_text(encoding="utf-8"))
    compile(changed, str(fault.path), "exec")
    assert fault.breaks
    for test in fault.tests.split():
        file, _, name = test.partition("::")
        text = (ROOT / "tests" / file).read_text(encoding="utf-8")
        assert f"def {name}(" in text or not name
