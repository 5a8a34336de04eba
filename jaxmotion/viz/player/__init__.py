"""Clips in a browser: one page of HTML that needs nothing else.

``page.py`` puts it together, ``encode.py`` says how clips are kept in it, ``arguments.py`` reads
what is asked for, ``thumbnail.py`` makes the small one of a notebook. The page itself is
``page.html``, ``style.css`` and the scripts of ``page.SCRIPTS``, joined as they are: no build step,
no library. ``main.js`` has on top what its address and ``window.jaxmotionPlayer`` understand.
"""

from jaxmotion.viz.player.page import Player, player

__all__ = ["Player", "player"]
