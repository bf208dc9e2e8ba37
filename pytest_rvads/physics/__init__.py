"""Physics: the world in pybullet, vehicle dynamics, braking, the simulation loop."""
