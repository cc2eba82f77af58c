"""Published experiments, run again: one folder a paper, theirs beside ours."""
