"""`python -m gloc3` is the program `gloc3`."""

from gloc3.cli.start import main

main()
