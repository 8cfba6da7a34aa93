"""What the benchmarks share: scenes, peers, records of results and the figure of fronts."""
