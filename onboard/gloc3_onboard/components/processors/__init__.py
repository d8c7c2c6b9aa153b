"""The processors of the example platforms, one component a file."""
