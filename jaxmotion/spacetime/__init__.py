"""Spacetime constraints: contacts, joint limits and the floor, kept over a whole clip at once."""

from typing import TYPE_CHECKING

from jaxmotion._lazy import loader
from jaxmotion.spacetime.joint_limits import JointLimits, learn_limits
from jaxmotion.spacetime.keeping import ConvergenceWarning, keep_contacts, restore
from jaxmotion.spacetime.report import Report

if TYPE_CHECKING:
    from jaxmotion.spacetime.solve import Weights, satisfy
else:  # hidden from type checkers, to which it would make every name one of this module
    # optimistix takes a third of a second to import.
    __getattr__ = loader(__name__, dict.fromkeys(("Weights", "satisfy"), "solve"))

__all__ = [
    "ConvergenceWarning",
    "JointLimits",
    "Report",
    "Weights",
    "keep_contacts",
    "learn_limits",
    "restore",
    "satisfy",
]
