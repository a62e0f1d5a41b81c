"""Batches of states and long logs on an NVIDIA GPU, through CuPy (the extra ``cuda``)."""

from echelon.gpu.model import Gpu

__all__ = ["Gpu"]
