"""Physics: worlds in physics engines, vehicle dynamics, braking."""
