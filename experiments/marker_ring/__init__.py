"""The `marker ring` paper: figures 7 and 9 and the limit of several contacts, its way and ours on one barrel."""
