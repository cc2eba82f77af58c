"""Methods as their papers print them, to compare with."""
