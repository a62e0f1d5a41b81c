"""Names that other rooms may use, and where each is defined."""

from echelon.dynamics.arguments import STATE as STATE
from echelon.dynamics.arguments import Arguments as Arguments
from echelon.dynamics.arguments import coordinate_units as coordinate_units
from echelon.dynamics.arguments import geometry_values as geometry_values
from echelon.dynamics.arguments import parameter_input as parameter_input
from echelon.dynamics.evaluate import evaluate_floats as evaluate_floats
from echelon.dynamics.evaluator import ClosedStates as ClosedStates
from echelon.dynamics.evaluator import CompiledAssembly as CompiledAssembly
from echelon.dynamics.evaluator import Evaluator as Evaluator
from echelon.dynamics.evaluator import Values as Values
from echelon.dynamics.evaluator import function_values as function_values
from echelon.dynamics.functions import ALL_FUNCTIONS as ALL_FUNCTIONS
from echelon.dynamics.functions import Builder as Builder
from echelon.dynamics.functions import motion_function as motion_function
from echelon.dynamics.functions import robot_function as robot_function
from echelon.dynamics.kinematics import Kinematics as Kinematics
from echelon.dynamics.kinematics import body_frames as body_frames
from echelon.dynamics.kinematics import moved as moved
from echelon.dynamics.linear_forms import FEW_COLUMNS as FEW_COLUMNS
from echelon.dynamics.linear_forms import LinearForms as LinearForms
from echelon.dynamics.linear_forms import Rows as Rows
from echelon.dynamics.linear_forms import energy_changes as energy_changes
from echelon.dynamics.linear_forms import energy_form as energy_form
from echelon.dynamics.linear_forms import (
    inverse_dynamics_regressor as inverse_dynamics_regressor,
)
from echelon.dynamics.linear_forms import power_form as power_form
from echelon.dynamics.linear_forms import powers_along as powers_along
from echelon.dynamics.linear_forms import rows_of as rows_of
from echelon.dynamics.linear_forms import virtual_power_form as virtual_power_form
from echelon.dynamics.loop_rows import assembly_of as assembly_of
from echelon.dynamics.loop_rows import joints_locked_by_loops as joints_locked_by_loops
from echelon.dynamics.models import LinearModel as LinearModel
from echelon.dynamics.models import evaluate_model as evaluate_model
from echelon.dynamics.models import model_of as model_of
