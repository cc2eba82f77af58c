"""Every claim with its figure: `python -m claims` measures them."""
