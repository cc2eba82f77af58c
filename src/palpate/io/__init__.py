"""Files in, values out, and back: the only room that reads and writes them."""
