"""``python -m jaxmotion``: the command line."""

from jaxmotion.cli import main

if __name__ == "__main__":
    main()
