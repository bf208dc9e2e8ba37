"""Abstract scenarios of a junction with their equivalence classes, and concrete scenarios on grids of distances and speeds."""
