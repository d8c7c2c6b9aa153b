"""The screens, one a file; `table` holds a row for each."""
