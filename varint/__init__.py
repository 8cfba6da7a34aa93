"""Mechanics by the principle of least action, on CasADi."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from varint.errors import ConvergenceError, InputError, SolverError, VarintError
from varint.numerics.files import VERSION
from varint.rules.rule import Rule, composition, gauss, lobatto, midpoint, trapezoidal
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates, time

if TYPE_CHECKING:
    from varint import course, diagnostics, models, multibody, orbits
    from varint.boundary.derivatives import action_derivatives
    from varint.boundary.families import paths
    from varint.boundary.least_action import least_action
    from varint.control.contradiction import Contradiction
    from varint.control.controller import Controller
    from varint.control.links import Link
    from varint.control.lqr import lqr
    from varint.control.mpc import closed_loop, mpc
    from varint.control.multistart import multistart
    from varint.control.optimal import optimal_control, optimal_phases
    from varint.control.phase import Phase
    from varint.control.prepared import Prepared, prepare
    from varint.control.refine import refine
    from varint.control.second_order import SecondOrder
    from varint.control.sensitivity import Sensitivity
    from varint.control.solution import ControlSolution
    from varint.discrete.projection import project
    from varint.discrete.reactions import reactions
    from varint.drawing.live import live_plot
    from varint.drawing.sketch import Sketch
    from varint.ensembles.ensemble import ensemble
    from varint.ensembles.result import Ensemble
    from varint.estimation.estimate import Estimate, Estimator
    from varint.estimation.fit import fit
    from varint.estimation.measurement import Experiment, Measurement
    from varint.estimation.mhe import mhe
    from varint.estimation.profile import Profile
    from varint.estimation.result import Fit
    from varint.explorer.play import play
    from varint.integration.plan import Plan, plan
    from varint.integration.simulate import simulate
    from varint.integration.start_momentum import start_momentum
    from varint.integration.step_function import step_function
    from varint.integration.time_transformation.time_scale import close_encounters
    from varint.load import load
    from varint.nlp.slacks import Soft, soft
    from varint.results.records import State
    from varint.results.trajectory import Trajectory
    from varint.scene.control_rate import control_rate
    from varint.scene.epigraph import abs as abs
    from varint.scene.epigraph import max as max
    from varint.scene.free import free
    from varint.scene.geodesic import geodesic
    from varint.scene.massless_limit import massless_limit
    from varint.sensitivities.events import EventSensitivity, event_sensitivity
    from varint.sensitivities.flow import flow
    from varint.sensitivities.gradient import Gradient, gradient
    from varint.sensitivities.tangents import sensitivity
    from varint.standalone.export import export
    from varint.symmetry.noether import noether, symmetries
    from varint.symmetry.symmetry import Symmetry
    from varint.symmetry.table import Symmetries
    from varint.typeset.equations import Equations, equations
    from varint.typeset.sympy_systems import from_sympy

__version__ = VERSION

__all__ = [
    "Contradiction",
    "ControlSolution",
    "Controller",
    "ConvergenceError",
    "Ensemble",
    "Equations",
    "Estimate",
    "Estimator",
    "EventSensitivity",
    "Experiment",
    "Fit",
    "Gradient",
    "InputError",
    "Link",
    "Measurement",
    "Parameters",
    "Phase",
    "Plan",
    "Prepared",
    "Profile",
    "Rule",
    "SecondOrder",
    "Sensitivity",
    "Sketch",
    "Soft",
    "SolverError",
    "State",
    "Symmetries",
    "Symmetry",
    "System",
    "Trajectory",
    "VarintError",
    "action_derivatives",
    "close_encounters",
    "closed_loop",
    "composition",
    "control_rate",
    "coordinates",
    "course",
    "diagnostics",
    "ensemble",
    "equations",
    "event_sensitivity",
    "export",
    "fit",
    "flow",
    "free",
    "from_sympy",
    "gauss",
    "geodesic",
    "gradient",
    "least_action",
    "live_plot",
    "load",
    "lobatto",
    "lqr",
    "massless_limit",
    "mhe",
    "midpoint",
    "models",
    "mpc",
    "multibody",
    "multistart",
    "noether",
    "optimal_control",
    "optimal_phases",
    "orbits",
    "paths",
    "plan",
    "play",
    "prepare",
    "project",
    "reactions",
    "refine",
    "sensitivity",
    "simulate",
    "soft",
    "start_momentum",
    "step_function",
    "symmetries",
    "time",
    "trapezoidal",
]

LIKE_PYTHON = ("abs", "max")  # public, but `import *` must not take Python's own away

# loaded when first named: nobody pays for what he does not use
_LATER = {
    "Ensemble": "varint.ensembles.result",
    "Equations": "varint.typeset.equations",
    "Contradiction": "varint.control.contradiction",
    "ControlSolution": "varint.control.solution",
    "Controller": "varint.control.controller",
    "Link": "varint.control.links",
    "Phase": "varint.control.phase",
    "Plan": "varint.integration.plan",
    "Prepared": "varint.control.prepared",
    "SecondOrder": "varint.control.second_order",
    "Sensitivity": "varint.control.sensitivity",
    "Sketch": "varint.drawing.sketch",
    "Soft": "varint.nlp.slacks",
    "State": "varint.results.records",
    "Symmetries": "varint.symmetry.table",
    "Symmetry": "varint.symmetry.symmetry",
    "Trajectory": "varint.results.trajectory",
    "abs": "varint.scene.epigraph",
    "action_derivatives": "varint.boundary.derivatives",
    "close_encounters": "varint.integration.time_transformation.time_scale",
    "closed_loop": "varint.control.mpc",
    "control_rate": "varint.scene.control_rate",
    "massless_limit": "varint.scene.massless_limit",
    "Estimate": "varint.estimation.estimate",
    "Estimator": "varint.estimation.estimate",
    "Experiment": "varint.estimation.measurement",
    "mhe": "varint.estimation.mhe",
    "Fit": "varint.estimation.result",
    "Profile": "varint.estimation.profile",
    "Gradient": "varint.sensitivities.gradient",
    "Measurement": "varint.estimation.measurement",
    "fit": "varint.estimation.fit",
    "flow": "varint.sensitivities.flow",
    "ensemble": "varint.ensembles.ensemble",
    "equations": "varint.typeset.equations",
    "event_sensitivity": "varint.sensitivities.events",
    "EventSensitivity": "varint.sensitivities.events",
    "export": "varint.standalone.export",
    "free": "varint.scene.free",
    "from_sympy": "varint.typeset.sympy_systems",
    "geodesic": "varint.scene.geodesic",
    "gradient": "varint.sensitivities.gradient",
    "least_action": "varint.boundary.least_action",
    "live_plot": "varint.drawing.live",
    "load": "varint.load",
    "lqr": "varint.control.lqr",
    "max": "varint.scene.epigraph",
    "mpc": "varint.control.mpc",
    "multistart": "varint.control.multistart",
    "noether": "varint.symmetry.noether",
    "optimal_control": "varint.control.optimal",
    "optimal_phases": "varint.control.optimal",
    "paths": "varint.boundary.families",
    "plan": "varint.integration.plan",
    "play": "varint.explorer.play",
    "prepare": "varint.control.prepared",
    "project": "varint.discrete.projection",
    "reactions": "varint.discrete.reactions",
    "refine": "varint.control.refine",
    "sensitivity": "varint.sensitivities.tangents",
    "simulate": "varint.integration.simulate",
    "soft": "varint.nlp.slacks",
    "start_momentum": "varint.integration.start_momentum",
    "step_function": "varint.integration.step_function",
    "symmetries": "varint.symmetry.noether",
}
_LATER_MODULES = ("course", "diagnostics", "models", "multibody", "orbits")


def __getattr__(name: str) -> Any:
    if name in _LATER:
        found = globals()[name] = getattr(import_module(_LATER[name]), name)
        return found
    if name in _LATER_MODULES:
        return import_module(f"varint.{name}")
    raise AttributeError(f"module 'varint' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, *LIKE_PYTHON])
