"""Other ways to a contact, as they are usually written: what an estimator is held against.

Each is made for a body and answers one reading at a time: a point (3,) [m], NaN where it has none, or rows of points
and forces. None of them says how sure it is.
"""
