"""`marker ring`: figures 7 and 9 and the limit of several contacts, the paper's way and ours on one simulated barrel."""
