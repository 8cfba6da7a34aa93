"""Many motions of one system: broadcast starts and parameters, chunks for any executor, results
on disk.
"""
