"""The samplers of the example platforms, one component a file."""
