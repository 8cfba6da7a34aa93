"""A scene to play with: sliders for parameters and start, and what the motion does then."""
