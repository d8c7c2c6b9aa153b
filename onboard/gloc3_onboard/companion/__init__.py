"""Component 191 for other people's software: commands, missions, parameters, files, metadata, control."""
