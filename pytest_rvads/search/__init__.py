"""Beyond the tables: metamorphic checks, falsification, strategies, chance, consistency of rules, power."""
