"""The `load cells` paper, run again on a simulated bench: its table I and its figure 7, theirs beside ours."""
