"""The experiment of the paper and what measures the checks themselves; users of the plugin need none of it."""
