"""Shows stations the topics of the platform, on demand."""
