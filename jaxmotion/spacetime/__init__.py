"""Spacetime constraints: contacts, joint limits and the floor, kept over a whole clip at once."""

from typing import TYPE_CHECKING

from jaxmotion._lazy import loader
from jaxmotion.spacetime.joint_limits import JointLimits, learn_limits

if TYPE_CHECKING:
    from jaxmotion.spacetime.solve import Report, Weights, satisfy

# optimistix takes a third of a second to import.
__getattr__ = loader(__name__, dict.fromkeys(("Report", "Weights", "satisfy"), "solve"))

__all__ = ["JointLimits", "Report", "Weights", "learn_limits", "satisfy"]
