"""Parameters and states of a scene from measurements."""
