"""Read delimited text: lines, fields and numbers, with every row accounted for."""
