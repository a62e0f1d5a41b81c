"""Arguments of kernels, on the device or not, checked once where they enter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.gpu.device import Array, Device
from echelon.machine.batch import Batch, check_shape, sample_count, value_of
from echelon.program.function import Argument


def arranged(device: Device, arguments: Sequence[Argument], values: Mapping[str, Any]) -> Batch:
    """The values of a function's arguments, each where it is: in NumPy's memory or on the device.

    Parameters
    ----------
    device : Device
    arguments : sequence of Argument
    values : mapping of str to array
        By the argument's name: of shape (samples, size), or (size,) for one sample and for uniform ones.

    Raises
    ------
    InputError
        If an argument is missing, holds no real numbers, or has a wrong shape.
    """
    columns: list[Array] = []
    uniform = [np.zeros(0)]
    for argument in arguments:
        array = device.real(argument.name, value_of(argument, values))
        if array.ndim == 1 and not argument.uniform:
            array = array.reshape(1, -1)
        check_shape(argument, array.shape)
        if argument.uniform:
            uniform.append(device.fetched(array))
        else:
            columns.append(array)
    count = sample_count(arguments, [len(column) for column in columns])
    return Batch(count, tuple(columns), np.concatenate(uniform))


def part_on(device: Device, given: Batch, first: int, end: int) -> Batch:
    """Some samples of a batch on the device, in double precision."""
    columns = (device.contiguous(device.sent(column[first:end]), np.float64) for column in given.columns)
    return Batch(min(end, given.samples) - first, tuple(columns), given.uniform)


def passed(
    device: Device, arguments: Sequence[Argument], given: Batch, first: int, end: int, dtype: npt.DTypeLike
) -> list[Array]:
    """What a kernel is called with for some samples: arrays of shape (size, samples), or (size,) where uniform."""
    columns, place = iter(given.columns), 0
    found = []
    for argument in arguments:
        if argument.uniform:
            array = device.sent(given.uniform[place : place + len(argument)])
            place += len(argument)
        else:
            array = device.sent(next(columns)[first:end]).T
        found.append(device.contiguous(array, dtype))
    return found
