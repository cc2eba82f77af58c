"""The laboratory: simulated worlds with their truth, public benchmark tasks and peers, the papers' own methods.

It comes with `palpate`, which never imports it: its commands (`palpate simulate`, `benchmark`, `demo`) join by an entry
point.
"""
