"""The tracking controller: what turns a wish, such as a target speed or a trajectory, into throttle, brake and steering."""
