"""Every error Echelon raises on purpose.  A message says what is wrong, where, and what would be valid."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class EchelonError(Exception):
    """Root of all deliberate errors; the command line turns it into one line and exit code 2."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies, such as those that other processes send, say the same, whatever the constructor takes."""
        return _said_again, (type(self), self.args), self.__dict__


def _said_again(kind: type[EchelonError], args: tuple[object, ...]) -> EchelonError:
    return kind.__new__(kind, *args)


class InputError(EchelonError):
    """A file or an argument cannot be accepted.

    Parameters
    ----------
    problem : str
        The fault, and a valid value.
    source : str, optional
        File (or other origin) that holds the offending element.
    element : str, optional
        The offending element, e.g. ``joint 'elbow'``.
    """

    def __init__(
        self, problem: str, *, source: str | None = None, element: str | None = None
    ) -> None:
        self.problem, self.source, self.element = problem, source, element
        super().__init__(
            one_line(": ".join(part for part in (source, element, problem) if part))
        )

    def located(self, source: str) -> InputError:
        """Copy of the error that names the file, unless one is named, for readers that learn the file's name last."""
        return InputError(
            self.problem, source=self.source or source, element=self.element
        )


def warn_caller(text: str, category: type[Warning]) -> None:
    """Warn at the line outside of this package that led here, however deep the call was."""
    frame, level = sys._getframe(1), 2
    while (
        frame.f_back is not None
        and frame.f_globals.get("__name__", "").split(".")[0] == "echelon"
    ):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)


@contextmanager
def locating(source: str) -> Iterator[None]:
    """Errors of an input in the block name this file, unless they name one already."""
    try:
        yield
    except InputError as error:
        raise error.located(source) from None


class MissingExtraError(EchelonError):
    """An optional dependency is not installed; the message names the extra that brings it."""

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(
            f"this needs the package '{package}': install it with  pip install \"echelon-robotics[{extra}]\""
        )


class AssemblyWarning(UserWarning):
    """A mechanism with loops is taken in a pose that is not near the stated one."""


class DoubtWarning(UserWarning):
    """Something speaks against a result.

    Lengths that are nearly equal in a loop speak against a number of base parameters; a negative moment of inertia
    speaks against the values of base parameters.
    """


class SlowWarning(UserWarning):
    """A large evaluation goes the slow way, because a package is not installed."""


class DegenerateSampleError(EchelonError):
    """A random point or prime fell on a zero of some denominator; the caller draws another."""


class SingularPoseError(EchelonError):
    """Closed states of a mechanism with loops are not proved to exist, or do not tell what is independent."""


class ClosedFormError(EchelonError):
    """No closed form was found within the budget, and no stated values give numbers; the rank is not affected."""


class CertificateError(EchelonError):
    """A base parameter set contradicts the model it claims to describe."""


def one_line(text: str) -> str:
    r"""Text without line breaks and terminal codes, for names that come from files.

    >>> one_line("arm\nof\x1b[31m steel")
    'arm of [31m steel'
    """
    return "".join(character if character.isprintable() else " " for character in text)


def shortened(text: str, most: int = 60) -> str:
    """Text on one line, cut after ``most`` characters, for messages that quote a file.

    >>> shortened("1 + " * 100)
    '1 + 1 + 1 + 1 + 1 + 1 + 1 + 1 + 1 + 1 + 1 + 1 + 1 + 1 + 1...'
    """
    line = one_line(text)
    return line if len(line) <= most else line[: most - 3] + "..."
