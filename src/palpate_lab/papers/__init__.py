"""Methods as printed in their papers, for comparison."""
