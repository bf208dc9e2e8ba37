"""Optional parts of the package, which `pytest` with built-in junctions does not need: a folder each, found by entry points."""
