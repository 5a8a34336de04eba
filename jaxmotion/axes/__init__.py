"""Which axis of the world points up: guessed from a motion, and exchanged for another."""

from jaxmotion.axes.guess import UpGuess, doubt_up, guess_up
from jaxmotion.axes.turn import reorient

__all__ = ["UpGuess", "doubt_up", "guess_up", "reorient"]
