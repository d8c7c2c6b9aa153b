"""The command link in a nutshell, for acoustic modems: some 80 bit/s, with seconds on the way."""
