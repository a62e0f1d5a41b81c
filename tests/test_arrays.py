"""Types and linear algebra that many modules share."""

from __future__ import annotations

from threadpoolctl import threadpool_info, threadpool_limits

from echelon.shared.arrays import one_thread


def threads() -> set[int]:
    return {
        library["num_threads"]
        for library in threadpool_info()
        if library["user_api"] == "blas"
    }


def test_linear_algebra_has_one_thread_for_a_while() -> None:
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with one_thread():
            assert threads() == {1}
        assert threads() == before
