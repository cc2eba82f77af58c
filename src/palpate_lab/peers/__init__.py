"""Other ways to find a contact, as they are usually written: peers to compare an estimator with.

Each peer is made for one body and answers one reading at a time: with a point (3,) [m], NaN where it finds none, or
with rows of points and forces. None of them states a covariance.
"""
