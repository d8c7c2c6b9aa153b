"""`python -m gloc3` is the program `gloc3`."""

from gloc3.cli import main

main()
