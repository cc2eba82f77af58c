"""The laboratory: simulations with their truth, public benchmark tasks and peers, and the papers' own methods.

It is installed with `palpate`, which never imports it: its commands (`palpate simulate`, `benchmark`, `demo`) are
found by an entry point.
"""
