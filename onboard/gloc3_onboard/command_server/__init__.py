"""The command interface server of a platform (paper §V), in parts that are plain objects."""
