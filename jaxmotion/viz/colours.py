"""The colours of all pictures, told apart by all eyes (Okabe and Ito 2008).

``SERIES`` is in the order in which curves take them; maps of size are ``SIZES``, pale to dark, and
of what has a sign ``SIGNS``, its middle white.
"""

BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"
PINK, SKY, GOLD, BLACK = "#cc79a7", "#56b4e9", "#e69f00", "#000000"
GREY, PALE = "#999999", "#e5e5e5"  # what is compared with; what is shaded
SERIES = (BLUE, ORANGE, GREEN, PINK, GOLD, SKY, BLACK)
SIZES, SIGNS = "Blues", "PuOr"
