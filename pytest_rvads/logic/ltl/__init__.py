"""Linear temporal logic over finite runs: formulas, automata, LTL3 monitors."""
