"""Pictures, which notebooks show. Matplotlib is loaded by the functions that draw with it: ``pip
install 'jaxmotion[viz]'``.

``colours``, ``given``, ``turns`` and ``picture`` hold nothing that is public.
"""

from jaxmotion.viz.alignment import plot_alignment
from jaxmotion.viz.contacts import plot_contacts
from jaxmotion.viz.cost_matrix import plot_cost_matrix
from jaxmotion.viz.denoising import plot_denoising_error
from jaxmotion.viz.digression import plot_digression
from jaxmotion.viz.invariance import plot_invariance
from jaxmotion.viz.keys import plot_key_interpolation
from jaxmotion.viz.layers import plot_layers
from jaxmotion.viz.player import Player, player
from jaxmotion.viz.poses import plot_poses
from jaxmotion.viz.pyramid import plot_pyramid
from jaxmotion.viz.recording import log_rerun
from jaxmotion.viz.repair import plot_repair
from jaxmotion.viz.seam import plot_seam
from jaxmotion.viz.texture import plot_texture
from jaxmotion.viz.time_warp import plot_time_warp
from jaxmotion.viz.trajectories import plot_trajectories
from jaxmotion.viz.wrap import plot_wrap

__all__ = [
    "Player",
    "log_rerun",
    "player",
    "plot_alignment",
    "plot_contacts",
    "plot_cost_matrix",
    "plot_denoising_error",
    "plot_digression",
    "plot_invariance",
    "plot_key_interpolation",
    "plot_layers",
    "plot_poses",
    "plot_pyramid",
    "plot_repair",
    "plot_seam",
    "plot_texture",
    "plot_time_warp",
    "plot_trajectories",
    "plot_wrap",
]
