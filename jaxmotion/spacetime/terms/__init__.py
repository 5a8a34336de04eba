"""What may be asked of a whole clip: a file a constraint, :mod:`.term` says what it owes.

A new one is a file here, and a line in ``solve._satisfy`` that makes it.
"""
