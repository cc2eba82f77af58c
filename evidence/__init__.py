"""Every claim with its figure: `python -m evidence` measures them and writes docs/evidence.md."""
