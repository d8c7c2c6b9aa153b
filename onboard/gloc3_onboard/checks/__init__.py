"""The pre-flight checks of a platform: pure functions from what is known to lines of the list."""
