"""Pinocchio in C++, timed there: the regressor of many samples, and single calls of RNEA."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from anchors.build import HERE, OPTIMISED, library, pinocchio_headers

Floats = npt.NDArray[np.float64]

# Fixed sizes of 3 and 6 gain nothing from Eigen's own vectors; measured on several machines, without them is faster.
FLAGS = ("-std=c++17", *OPTIMISED, "-DEIGEN_DONT_VECTORIZE")
# What the CMake files of Pinocchio 4 tell their users to define.
_BOOST = (
    "-DBOOST_MPL_LIMIT_LIST_SIZE=30",
    "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    "-DBOOST_FUSION_INVOKE_MAX_ARITY=12",
)
_UNALIGNED = {
    "JointModelRevoluteUnaligned": "RU",
    "JointModelPrismaticUnaligned": "PU",
    "JointModelFreeFlyer": "FF",
}


@cache
def _loaded() -> ctypes.CDLL:
    built = library(
        [HERE / "pinocchio_anchor.cpp"], (*FLAGS, *_BOOST, *pinocchio_headers())
    )
    built.anchor_robot.restype = ctypes.c_void_p
    built.anchor_regressor.restype = built.anchor_rnea.restype = ctypes.c_double
    built.anchor_aba.restype = ctypes.c_double
    return built


class CppRobot:
    """A Pinocchio model in C++, the same joints and bodies as a model in Python.

    Parameters
    ----------
    model : pinocchio.Model

    Raises
    ------
    UnavailableError
        If the anchor cannot be compiled here.
    """

    def __init__(self, model: Any) -> None:
        self.nq, self.nv, self.columns = model.nq, model.nv, 10 * (model.njoints - 1)
        self._library = _loaded()
        joints = range(1, model.njoints)
        kinds = [model.joints[j].shortname() for j in joints]
        short = [
            _UNALIGNED.get(kind) or kind.removeprefix("JointModel") for kind in kinds
        ]
        axes = np.array([_axis(model.joints[j]) for j in joints])
        places = np.array(
            [
                [*p.rotation.ravel(), *p.translation]
                for p in list(model.jointPlacements)[1:]
            ]
        )
        bodies = np.array(
            [[i.mass, *i.lever, *i.inertia.ravel()] for i in list(model.inertias)[1:]]
        )
        parents = np.array([model.parents[j] for j in joints], dtype=np.int32)
        names = (ctypes.c_char_p * len(short))(*(s.encode() for s in short))
        self._handle = ctypes.c_void_p(
            self._library.anchor_robot(
                ctypes.c_int(len(short)),
                _pointer(parents),
                names,
                _pointer(axes),
                _pointer(places),
                _pointer(bodies),
            )
        )
        if not self._handle:
            raise ValueError(
                f"a kind of joint is unknown to the anchor: {sorted(set(kinds))}"
            )

    def __del__(self) -> None:
        if getattr(self, "_handle", None):
            self._library.anchor_free(self._handle)

    def regressor(
        self,
        states: tuple[Floats, Floats, Floats],
        out: Floats | None,
        threads: int = 1,
    ) -> float:
        """Seconds to fill `out` of shape (N, nv, columns); without it, to compute and drop the regressors."""
        if out is not None and out.shape != (len(states[0]), self.nv, self.columns):
            raise ValueError(f"W has the shape {out.shape}")
        return float(
            self._library.anchor_regressor(
                self._handle,
                ctypes.c_int64(len(states[0])),
                *map(_pointer, states),
                None if out is None else _pointer(out),
                ctypes.c_int(threads),
            )
        )

    def rnea(
        self, states: tuple[Floats, Floats, Floats], out: Floats, rounds: int = 1
    ) -> float:
        """Seconds for single calls of RNEA, once per state and round; the last torques are left in `out`."""
        return self._calls(self._library.anchor_rnea, states, out, rounds)

    def aba(
        self, states: tuple[Floats, Floats, Floats], out: Floats, rounds: int = 1
    ) -> float:
        """Seconds for single calls of ABA with torques in the place of accelerations."""
        return self._calls(self._library.anchor_aba, states, out, rounds)

    def _calls(
        self,
        function: Any,
        states: tuple[Floats, Floats, Floats],
        out: Floats,
        rounds: int,
    ) -> float:
        count = ctypes.c_int64(len(states[0]))
        arguments = (
            self._handle,
            count,
            *map(_pointer, states),
            _pointer(out),
            ctypes.c_int64(rounds),
        )
        return float(function(*arguments))


def _axis(joint: Any) -> Any:
    return (
        joint.extract().axis
        if hasattr(joint, "extract") and joint.shortname() in _UNALIGNED
        else np.zeros(3)
    )


def _pointer(array: npt.NDArray[Any]) -> ctypes.c_void_p:
    if not array.flags.c_contiguous:
        raise ValueError("an array must be contiguous")
    return ctypes.c_void_p(array.ctypes.data)
