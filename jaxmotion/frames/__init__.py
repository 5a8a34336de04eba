"""Frames of clips, without the clips: which of them count, runs of them, what goes on beyond their
ends, padding. Arrays have time in front. For the rooms above; users meet it in their arguments.

The library's own: not public, but for what ``jaxmotion.timing`` names.
"""
