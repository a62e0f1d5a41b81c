"""Observation matrices without the matrix: R-factors of stacked regressors, block by block."""

from echelon.compute.observe.accumulate import BLOCK as BLOCK
from echelon.compute.observe.accumulate import Observer as Observer
from echelon.compute.observe.observation import Layout as Layout
from echelon.compute.observe.observation import NormalEquations as NormalEquations
from echelon.compute.observe.observation import Observation as Observation
from echelon.compute.observe.observation import checked_weights as checked_weights
from echelon.compute.observe.observation import layout_of as layout_of
from echelon.compute.observe.observation import measured as measured
from echelon.compute.observe.triangle import Triangle as Triangle
from echelon.compute.observe.triangle import column_norms as column_norms
from echelon.compute.observe.triangle import upper_triangle as upper_triangle
