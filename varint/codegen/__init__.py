"""Generated C: the inner loop of a run, built from the scene's expressions, compiled once and
cached.
"""
