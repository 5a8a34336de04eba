"""Pictures. Matplotlib is loaded by the functions that draw with it: ``pip install
'jaxmotion[viz]'``."""

from jaxmotion.viz.alignment import plot_alignment

__all__ = ["plot_alignment"]
