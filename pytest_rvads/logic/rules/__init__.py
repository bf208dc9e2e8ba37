"""Rules: their formulas, the predicates of their language, their parts, and the books that hold rules."""
