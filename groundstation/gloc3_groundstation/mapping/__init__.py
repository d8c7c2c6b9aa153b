"""What the map and the charts draw, without the terminal: histories, requested paths, and where everything lies."""
