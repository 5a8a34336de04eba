"""Pictures, which notebooks show, and recordings. Matplotlib is loaded by the functions that draw
with it (``pip install 'jaxmotion[viz]'``), rerun by the one that logs to it
(``'jaxmotion[rerun]'``)."""

from jaxmotion.viz.alignment import plot_alignment
from jaxmotion.viz.contacts import plot_contacts
from jaxmotion.viz.digression import plot_digression
from jaxmotion.viz.player import Player, player
from jaxmotion.viz.recording import log_rerun
from jaxmotion.viz.repair import plot_repair

__all__ = [
    "Player",
    "log_rerun",
    "player",
    "plot_alignment",
    "plot_contacts",
    "plot_digression",
    "plot_repair",
]
