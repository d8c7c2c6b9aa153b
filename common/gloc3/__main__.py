"""`python -m gloc3` is the program `gloc3`."""

from gloc3.start import main

main()
