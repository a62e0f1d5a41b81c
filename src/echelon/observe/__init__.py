"""Observation matrices without the matrix: R-factors of stacked regressors, block by block."""

from echelon.observe.accumulate import BLOCK as BLOCK
from echelon.observe.accumulate import Observer as Observer
from echelon.observe.observation import Layout as Layout
from echelon.observe.observation import NormalEquations as NormalEquations
from echelon.observe.observation import Observation as Observation
from echelon.observe.observation import checked_weights as checked_weights
from echelon.observe.observation import layout_of as layout_of
from echelon.observe.observation import measured as measured
from echelon.observe.triangle import Triangle as Triangle
from echelon.observe.triangle import column_norms as column_norms
from echelon.observe.triangle import upper_triangle as upper_triangle
