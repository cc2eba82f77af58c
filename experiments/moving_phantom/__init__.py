"""The `probe` paper's second half: tables I and II and figure 10, its control and ours on one moving phantom."""
