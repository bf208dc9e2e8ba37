"""Rules: formulas, predicates, shapes, and the books that hold rules."""
