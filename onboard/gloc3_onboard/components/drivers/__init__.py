"""The drivers of the example platforms, one component a file."""
