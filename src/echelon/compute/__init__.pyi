"""Names that other rooms may use, and where each is defined."""

from echelon.compute.machine.kernel import Kernel as Kernel
from echelon.compute.machine.kernel import real_array as real_array
from echelon.compute.machine.kernel import value_of as value_of
from echelon.compute.machine.threads import VARIABLES as VARIABLES
from echelon.compute.observe.accumulate import Observer as Observer
from echelon.compute.observe.observation import Layout as Layout
from echelon.compute.observe.observation import NormalEquations as NormalEquations
from echelon.compute.observe.observation import Observation as Observation
from echelon.compute.observe.observation import restricted as restricted
from echelon.compute.observe.triangle import Triangle as Triangle
from echelon.compute.observe.triangle import column_norms as column_norms
from echelon.compute.observe.triangle import safe_norms as safe_norms
from echelon.compute.observe.triangle import upper_triangle as upper_triangle
from echelon.compute.tensors import TensorFunction as TensorFunction
from echelon.compute.tensors import TensorFunctions as TensorFunctions
from echelon.compute.tensors import TensorLibrary as TensorLibrary
