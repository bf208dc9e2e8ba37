"""What the main job does not need: each folder is found by the entry points that pyproject.toml declares for it."""
