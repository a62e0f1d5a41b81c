"""Settings for the whole test run, docstrings included."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from hypothesis import Phase, settings

# Before anything imports NumPy: matrices are small here, and threads that wait for one another take turns with those of
# the other workers.  Commands in processes of their own inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

# The same examples on every run, and no time limit per example: the first one pays for imports and caches.
settings.register_profile("echelon", deadline=None, derandomize=True, max_examples=20)
settings.load_profile("echelon")
# for `make slow`
settings.register_profile("thorough", settings.get_profile("echelon"), max_examples=200)
# for `make mutate`, which only wants to know whether a test fails: no search for the smallest example that does
settings.register_profile(
    "unshrunk",
    settings.get_profile("echelon"),
    max_examples=40,
    phases=(Phase.explicit, Phase.generate),
)


@pytest.fixture(scope="session", autouse=True)
def folders_of_the_run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What is kept between commands is kept in folders of this run; the user's own are not used."""
    with pytest.MonkeyPatch.context() as patch:
        base = tmp_path_factory.getbasetemp()
        shared = (
            base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
        )  # by all workers
        patch.setenv("ECHELON_CACHE", str(shared / "machine-code"))
        patch.setenv("ECHELON_STATE", str(tmp_path_factory.mktemp("state")))
        yield
