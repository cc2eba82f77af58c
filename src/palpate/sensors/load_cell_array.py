"""Stub."""


class LoadCellArray:
    pass
