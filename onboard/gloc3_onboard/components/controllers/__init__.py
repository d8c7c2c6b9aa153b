"""The controllers of the example platforms, one component a file."""
