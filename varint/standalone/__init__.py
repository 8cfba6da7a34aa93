"""Code that leaves: a step or a controller as C99 that stands alone."""
