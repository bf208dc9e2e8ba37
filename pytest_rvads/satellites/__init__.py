"""Optional parts of the package, each in a folder and found by an entry point. Tests at built-in junctions need no such part."""
