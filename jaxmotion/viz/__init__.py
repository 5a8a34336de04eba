"""Pictures, which notebooks show. Matplotlib is loaded by the functions that draw with it: ``pip
install 'jaxmotion[viz]'``."""

from jaxmotion.viz.alignment import plot_alignment
from jaxmotion.viz.contacts import plot_contacts

__all__ = ["plot_alignment", "plot_contacts"]
