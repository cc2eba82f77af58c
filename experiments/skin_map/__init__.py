"""The skin map paper (papers' short name `skin map`): its B-spline of the wrist, and where cells come to lie."""
