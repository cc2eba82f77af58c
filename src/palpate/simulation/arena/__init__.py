"""The arena of touch navigation: robots in soft skins among walls and blocks, what their skins do, what cameras see."""
