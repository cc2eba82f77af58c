"""The `marker ring` paper's second half: figures 11 and 12, its state machine and ours in arenas that nobody sees."""
