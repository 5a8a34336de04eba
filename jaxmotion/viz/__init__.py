"""Pictures, which notebooks show. Matplotlib is loaded by the functions that draw with it: ``pip
install 'jaxmotion[viz]'``."""

from jaxmotion.viz.alignment import plot_alignment
from jaxmotion.viz.contacts import plot_contacts
from jaxmotion.viz.digression import plot_digression
from jaxmotion.viz.player import Player, player
from jaxmotion.viz.repair import plot_repair

__all__ = ["Player", "player", "plot_alignment", "plot_contacts", "plot_digression", "plot_repair"]
